"""One tick of a tree of 20 nodes, here and in the two libraries people use."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from itertools import repeat
from time import process_time
from typing import Any, Final, NamedTuple

from benchmarks.figure import Effort, Figure, at_most
from benchmarks.turns import medians, ratio, turns
from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import FAILURE, RUNNING, STATUS_NAMES, GuardArgs, Node, size
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.domains.island.vocabulary import VOCABULARY

TREE: Final = """
subtree recharge = sequence { SeekCharger ExecuteCharge }
selector {
  when batteryLevel < 20 abort lower { use recharge }
  when robotCurrentExtraCapacity <= 5 { DeliverToClearingPoint }
  when isHumanoidWantToClear { MoveToHumanoid }
  when foundGarbage { sequence { MoveToGarbage PickupGarbage } }
  when lap >= 3 { sequence { when batteryLevel < 90 { use recharge } } }
  PatrolWaypoint
}
"""


class Situation(NamedTuple):
    """What a tick meets."""

    board: tuple[float, ...]  # battery, room, lap, garbage in sight, a humanoid asks
    leaves: int  # the status that every leaf returns


RESUMING: Final = tuple(  # a branch each: the tick finds its leaf and resumes it
    Situation(board, RUNNING)
    for board in (
        (15.0, 30.0, 0.0, 0.0, 0.0),
        (60.0, 4.0, 0.0, 0.0, 0.0),
        (60.0, 30.0, 0.0, 0.0, 1.0),
        (60.0, 30.0, 0.0, 1.0, 0.0),
        (60.0, 30.0, 3.0, 0.0, 0.0),
        (60.0, 30.0, 0.0, 0.0, 0.0),
    )
)
WALKING: Final = (Situation((15.0, 4.0, 3.0, 1.0, 1.0), FAILURE),)  # all guards hold, all fails

TICKS: Final = {Effort.TINY: 10, Effort.QUICK: 500, Effort.FULL: 2000}  # in each situation
ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 5, Effort.FULL: 15}

Prepare = Callable[[Situation], Callable[[], object]]  # gives a tick in that situation


def measure(effort: Effort) -> list[Figure]:
    """A tick that resumes a leaf (mean over the branches), and one that walks the whole tree."""
    tree = parse(TREE)
    assert size(tree) == 20
    libraries: dict[str, Prepare] = {"islandgp": _ours(tree)}
    absent = []
    for name, make in (("py_trees", _py_trees), ("behaviortreepy", _behaviortreepy)):
        if find_spec(name) is None:
            absent.append(f"{name} is not installed; pip install 'islandgp[bench]'")
        else:
            libraries[name] = make(tree)
    figures = []
    for kind, situations, meaning in (
        ("tick", RESUMING, "a tick of 20 nodes that resumes its leaf; leaves in Python"),
        ("walk", WALKING, "a tick that tries every branch of the 20 nodes in vain"),
    ):
        ticks = TICKS[effort] * len(situations)
        sides = [_many(prepare, situations, TICKS[effort]) for prepare in libraries.values()]
        rows = turns(sides, ROUNDS[effort], clock=process_time)
        us = [1e6 * seconds / ticks for seconds in medians(rows)]
        warning = "; ".join(absent)
        figures.append(Figure(f"{kind}_us", us[0], "us", meaning, at_most(2.0), warning))
        for at, name in list(enumerate(libraries))[1:]:
            figures += [
                Figure(f"{kind}_us_{name}", us[at], "us", f"the same in {name}"),
                Figure(f"{kind}_ratio_{name}", ratio(rows, at, 0), "", f"{name} / islandgp"),
            ]
    return figures


def _many(prepare: Prepare, situations: tuple[Situation, ...], ticks: int) -> Callable[[], object]:
    def run() -> None:
        for situation in situations:
            tick = prepare(situation)
            for _ in repeat(None, ticks):
                tick()

    return run


def _ours(tree: Node) -> Prepare:
    board = [0.0] * len(VOCABULARY.keys)
    status = RUNNING
    tick = compile_tree(
        tree,
        dict.fromkeys(VOCABULARY.actions, lambda _fresh: status),
        board,
        VOCABULARY.key_index,
    )

    def prepare(situation: Situation) -> Callable[[], object]:
        nonlocal status
        board[:], status = situation
        return tick

    return prepare


def _py_trees(tree: Node) -> Prepare:
    from py_trees.behaviour import Behaviour
    from py_trees.blackboard import Blackboard, Client
    from py_trees.common import Access, Status
    from py_trees.trees import BehaviourTree

    from benchmarks.peer.episode import create_tree

    status = Status.RUNNING

    class Leaf(Behaviour):
        def update(self) -> Status:
            return status

    Blackboard.clear()
    root = BehaviourTree(create_tree(tree, Leaf))
    writer = Client(name="robot")
    for key in VOCABULARY.keys:
        writer.register_key(key, access=Access.WRITE)

    def prepare(situation: Situation) -> Callable[[], object]:
        nonlocal status
        status = Status[STATUS_NAMES[situation.leaves]]
        for key, value in zip(VOCABULARY.keys, situation.board, strict=True):
            writer.set(key, value)
        return root.tick

    return prepare


def _with_library_nodes(tree: Node) -> Node:
    """The tree with guards that interrupt nothing, as the package does not have our nodes."""
    args = tree.args._replace(abort="self") if isinstance(tree.args, GuardArgs) else tree.args
    return Node(tree.kind, args, tuple(map(_with_library_nodes, tree.children)))


def _behaviortreepy(tree: Node) -> Prepare:
    import behaviortreepy  # type: ignore[import-untyped]  # it has no types

    names: Any = behaviortreepy.NodeStatus
    status = names.RUNNING
    factory = behaviortreepy.BehaviorTreeFactory()
    for name in VOCABULARY.actions:
        factory.register_simple_stateful_action(name, lambda _: status, lambda _: status)
    engine = factory.create_tree_from_text(to_xml(_with_library_nodes(tree), VOCABULARY))
    board = engine.root_blackboard()

    def prepare(situation: Situation) -> Callable[[], object]:
        nonlocal status
        status = getattr(names, STATUS_NAMES[situation.leaves])
        for (name, key), value in zip(VOCABULARY.keys.items(), situation.board, strict=True):
            (board.set_bool if key.flag else board.set_double)(name, value)
        tick: Callable[[], object] = engine.tick_exactly_once
        return tick

    return prepare
