"""The nouns of the tree language: nodes, and the tables of kinds, actions and keys.

Section 2.2.3 of the paper. These tables are the only place where an action, a
blackboard key or a node kind is declared; the grammar's words, the generator of
random trees, the prompts, the exporters and the documentation are made from
them or checked against them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

# Statuses are plain integers because a tick is the innermost loop of a run.
FAILURE: Final = 0
SUCCESS: Final = 1
RUNNING: Final = 2
AGAIN: Final = 3  # running, and the very next tick will do something (a repetition is due)

STATUS_NAMES: Final = ("FAILURE", "SUCCESS", "RUNNING", "RUNNING")


class Node(NamedTuple):
    """One node of a Behaviour Tree; a tree is its root. Equal nodes are equal trees."""

    kind: str  # a key of KINDS
    args: tuple[str | float, ...] = ()  # as KINDS[kind].args tells
    children: tuple[Node, ...] = ()


@dataclass(frozen=True, slots=True)
class Kind:
    """What a node of a kind is made of."""

    args: tuple[str, ...]  # names of Node.args, in order
    children: tuple[int, int]  # fewest and most children
    meaning: str  # one line for people


@dataclass(frozen=True, slots=True)
class Action:
    """A leaf that acts on the island."""

    meaning: str  # one line: when it succeeds, fails, runs


@dataclass(frozen=True, slots=True)
class Key:
    """A blackboard entry that a `when` can ask for."""

    flag: bool  # true: yes or no; false: a number
    low: float  # least value
    high: float  # greatest value that a random threshold takes
    step: float  # distance between random thresholds
    meaning: str  # one line, with the unit


ANY: Final = 1_000_000  # "as many children as the limits allow"

KINDS: Final[dict[str, Kind]] = {
    "selector": Kind((), (1, ANY), "tries its children in order until one succeeds"),
    "sequence": Kind((), (1, ANY), "runs its children in order until one fails"),
    "parallel": Kind(("success", "failure"), (1, ANY), "runs all its children at once"),
    "inverter": Kind((), (1, 1), "turns success into failure and failure into success"),
    "repeater": Kind(("count",), (1, 1), "runs its child until it has succeeded that often"),
    "when": Kind(
        ("key", "op", "number", "abort"), (1, 1), "runs its child while a condition holds"
    ),
    "action": Kind(("name",), (0, 0), "acts on the island"),
}

ACTIONS: Final[dict[str, Action]] = {
    "MoveToGarbage": Action(
        "drives to the nearest garbage in sight; succeeds within reach of it,"
        " fails when none is in sight"
    ),
    "PickupGarbage": Action(
        "picks up one item within reach; succeeds at once,"
        " fails when nothing is in reach or there is no room"
    ),
    "SeekCharger": Action("drives to the nearest charger; succeeds on arrival"),
    "ExecuteCharge": Action(
        "charges; succeeds when the battery is full, fails away from a charger or at 95 % and above"
    ),
    "MoveToHumanoid": Action(
        "drives to the nearest humanoid in sight that asks for clearing and takes over its garbage;"
        " fails when none asks or there is no room"
    ),
    "DeliverToClearingPoint": Action(
        "drives to the nearest clearing point and unloads; succeeds when something was unloaded,"
        " fails with a penalty when the robot is empty"
    ),
    "PatrolWaypoint": Action("drives to the next patrol waypoint; succeeds on arrival"),
}

KEYS: Final[dict[str, Key]] = {
    "batteryLevel": Key(False, 0, 100, 5, "charge of the battery in percent, 0 to 100"),
    "robotCurrentExtraCapacity": Key(False, 0, 30, 1, "room left for garbage in items, 0 to 30"),
    "lap": Key(False, 0, 5, 1, "patrol rounds finished, from 0"),
    "foundGarbage": Key(True, 0, 1, 1, "garbage is in sight"),
    "isHumanoidWantToClear": Key(True, 0, 1, 1, "a humanoid in sight asks for clearing"),
}

OPERATORS: Final = ("<", "<=", ">", ">=", "==", "!=")
FLAG_OPERATORS: Final = ("is", "not")  # `when FLAG` and `when not FLAG`; their number is 0
ABORTS: Final = ("none", "self", "lower", "both")  # the last is the default
POLICIES: Final = ("one", "all")  # how many children of a parallel decide
REPEATS: Final = (1, 100)  # fewest and most repetitions


def walk(node: Node) -> Iterator[Node]:
    """The nodes of a tree in document order (a parent before its children)."""
    yield node
    for child in node.children:
        yield from walk(child)


def size(node: Node) -> int:
    """Number of nodes, >= 1."""
    return 1 + sum(map(size, node.children))


def depth(node: Node) -> int:
    """Number of levels, >= 1: a single action has depth 1."""
    return 1 + max(map(depth, node.children), default=0)


def levels(tree: Node, level: int = 1) -> list[int]:
    """The level of each node, the root's being 1, in document order."""
    return [level, *(below for child in tree.children for below in levels(child, level + 1))]


def measured(tree: Node) -> list[tuple[Node, int, int]]:
    """Each node with its size and depth, in document order."""
    below: list[tuple[Node, int, int]] = []
    depths = [0]
    for child in tree.children:
        nodes = measured(child)
        depths.append(nodes[0][2])
        below += nodes
    return [(tree, 1 + len(below), 1 + max(depths)), *below]


def replace_at(tree: Node, index: int, new: Node) -> Node:
    """The tree with its node number `index` (document order, root 0) replaced by `new`."""
    if index == 0:
        return new
    index -= 1
    for i, child in enumerate(tree.children):
        n = size(child)
        if index < n:
            child = replace_at(child, index, new)
            return tree._replace(children=(*tree.children[:i], child, *tree.children[i + 1 :]))
        index -= n
    raise IndexError("expected an index below the tree's size")
