"""Exported trees mean the same in the libraries they are written for, but for the stated losses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from islandgp.bt.engine import compile_tree
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.node import FAILURE, KEYS, RUNNING, SUCCESS, Node, walk
from tests.strategies import few_boards, few_numbers, nodes

BOARDS = st.lists(few_boards(), min_size=2, max_size=14)
RESULTS = st.lists(st.sampled_from([FAILURE, SUCCESS, RUNNING, RUNNING]), min_size=1, max_size=40)
TREES = nodes(few_numbers(), max_leaves=10, max_repeats=3)
FEW = settings(
    max_examples=300, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
)

Call = tuple[str, bool]  # (leaf, fresh)
Trace = list[tuple[list[Call], str]]  # per tick the calls, and the root's status


def with_own_names(node: Node, numbers: Iterator[int]) -> Node:
    """The tree with a name of its own for each leaf, so that calls tell leaves apart."""
    if node.kind == "action":
        return Node("action", (f"Leaf{next(numbers)}",))
    return node._replace(children=tuple(with_own_names(child, numbers) for child in node.children))


def leaves(tree: Node) -> list[str]:
    return [str(node.args[0]) for node in walk(tree) if node.kind == "action"]


class Script:
    """What leaves return, one result after the other, and who called."""

    def __init__(self, results: list[int]) -> None:
        self.calls: list[Call] = []
        self._results = results
        self._taken = 0

    def call(self, name: str, fresh: bool) -> int:
        self.calls.append((name, fresh))
        self._taken += 1
        return self._results[(self._taken - 1) % len(self._results)]

    def take(self) -> list[Call]:
        calls, self.calls = self.calls, []
        return calls


def ours(tree: Node, boards: list[list[float]], results: list[int]) -> Trace:
    script, board = Script(results), list(boards[0])

    def action(name: str) -> Callable[[bool], int]:
        return lambda fresh: script.call(name, fresh)

    tick = compile_tree(tree, {name: action(name) for name in leaves(tree)}, board)
    trace: Trace = []
    for values in boards:
        board[:] = values
        status = ("FAILURE", "SUCCESS", "RUNNING", "RUNNING")[tick()]
        trace.append((script.take(), status))
    return trace


def in_behaviortree_cpp(tree: Node, boards: list[list[float]], results: list[int]) -> Trace:
    """The same in the real library, from the exported XML."""
    cpp: Any = pytest.importorskip("behaviortreepy", reason="extra `btcpp` is not installed")
    script = Script(results)
    statuses = (cpp.NodeStatus.FAILURE, cpp.NodeStatus.SUCCESS, cpp.NodeStatus.RUNNING)
    factory = cpp.BehaviorTreeFactory()
    for name in leaves(tree):
        factory.register_simple_stateful_action(
            name,
            lambda _, name=name: statuses[script.call(name, True)],
            lambda _, name=name: statuses[script.call(name, False)],
        )
    made = factory.create_tree_from_text(behaviortree_cpp.to_xml(tree))
    board = made.root_blackboard()
    trace: Trace = []
    for values in boards:
        for (name, key), value in zip(KEYS.items(), values, strict=True):
            (board.set_bool if key.flag else board.set_double)(name, value)
        status = made.tick_exactly_once().name
        trace.append((script.take(), status))
    return trace


def in_py_trees(tree: Node, boards: list[list[float]], results: list[int]) -> Trace:
    """The same in the real library, from the exported module."""
    library: Any = pytest.importorskip("py_trees", reason="extra `pytrees` is not installed")
    script = Script(results)
    names = library.common.Status
    statuses = (names.FAILURE, names.SUCCESS, names.RUNNING)

    class Leaf(library.behaviour.Behaviour):  # type: ignore[misc]
        fresh = True

        def initialise(self) -> None:
            self.fresh = True

        def update(self) -> Any:
            fresh, self.fresh = self.fresh, False
            return statuses[script.call(self.name, fresh)]

    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree), module)
    library.blackboard.Blackboard.clear()
    root = module["create_tree"](Leaf)
    writer = library.blackboard.Client(name="robot")
    for name in KEYS:
        writer.register_key(name, access=library.common.Access.WRITE)
    trace: Trace = []
    for values in boards:
        for name, value in zip(KEYS, values, strict=True):
            writer.set(name, value)
        root.tick_once()
        trace.append((script.take(), root.status.name))
    return trace


@FEW
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_behaviortree_cpp_means_the_same(
    tree: Node, boards: list[list[float]], results: list[int]
) -> None:
    """A tree without stated losses makes the same calls in BehaviorTree.CPP, tick by tick."""
    tree = with_own_names(tree, iter(range(100)))
    assume(not behaviortree_cpp.losses(tree))
    assert in_behaviortree_cpp(tree, boards, results) == ours(tree, boards, results)


@FEW
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_py_trees_means_the_same(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """A tree without stated losses makes the same calls in py_trees, tick by tick."""
    tree = with_own_names(tree, iter(range(100)))
    assume(not py_trees.losses(tree))
    assert in_py_trees(tree, boards, results) == ours(tree, boards, results)
