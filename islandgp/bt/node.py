"""The nouns of the tree language: nodes, the table of their kinds, and how large a tree may be.

Section 2.2.3 of the paper. A node kind is declared here and nowhere else; actions
and blackboard keys are a domain's (`vocabulary`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.condition import Asked, Compound, Condition, terms
from islandgp.errors import LimitError

# Statuses are plain integers because a tick is the innermost loop of a run.
FAILURE: Final = 0
SUCCESS: Final = 1
RUNNING: Final = 2
AGAIN: Final = 3  # running, and the very next tick will do something (a repetition is due)

STATUS_NAMES: Final = ("FAILURE", "SUCCESS", "RUNNING", "RUNNING")


Argument: TypeAlias = str | float | Asked


class Node(NamedTuple):
    """One node of a Behaviour Tree; a tree is its root. Equal nodes are equal trees."""

    kind: str  # a key of KINDS
    args: tuple[Argument, ...] = ()  # as KINDS[kind].args tells
    children: tuple[Node, ...] = ()


class Used(Node):
    """The root of a named subtree where it is used; equal to the same node without a name."""

    names: tuple[str, ...] = ()
    """As `use` says them, `recharge(20, 3)`; several, the outermost first, where a subtree is
    nothing but another one."""

    @classmethod
    def of(cls, node: Node, name: str) -> Used:
        """The node under that name, outside of those that it has."""
        made = cls._make(node)
        made.names = (name, *names_of(node))
        return made


def names_of(node: Node) -> tuple[str, ...]:
    """The names of the subtrees whose root this is; the outermost first."""
    return node.names if isinstance(node, Used) else ()


@dataclass(frozen=True, slots=True)
class Kind:
    """What a node of a kind is made of."""

    args: tuple[str, ...]  # names of Node.args, in order
    children: tuple[int, int]  # fewest and most children
    meaning: str  # one line for people


ANY: Final = 1_000_000  # "as many children as the limits allow"

KINDS: Final[dict[str, Kind]] = {
    "selector": Kind((), (1, ANY), "tries its children in order until one succeeds"),
    "sequence": Kind((), (1, ANY), "runs its children in order until one fails"),
    "parallel": Kind(("success", "failure"), (1, ANY), "runs all its children at once"),
    "inverter": Kind((), (1, 1), "turns success into failure and failure into success"),
    "repeater": Kind(("count",), (1, 1), "runs its child until it has succeeded that often"),
    "when": Kind(("condition", "abort"), (1, 1), "runs its child while a condition holds"),
    "action": Kind(("name",), (0, 0), "acts on the world"),
}

ABORTS: Final = ("none", "self", "lower", "both")  # the last is the default
POLICIES: Final = ("one", "all")  # how many children of a parallel decide
REPEATS: Final = (1, 100)  # fewest and most repetitions


def condition_of(guard: Node) -> Asked:
    """The condition of a `when`."""
    asked = guard.args[0]
    assert isinstance(asked, Condition | Compound)
    return asked


def count_of(repeater: Node) -> int:
    """The repetitions of a repeater."""
    count = repeater.args[0]
    assert isinstance(count, int | float)
    return int(count)


def walk(node: Node) -> Iterator[Node]:
    """The nodes of a tree in document order (a parent before its children)."""
    yield node
    for child in node.children:
        yield from walk(child)


def asked_in(tree: Node) -> Iterator[Condition]:
    """The single conditions that the guards of a tree ask, in document order."""
    for node in walk(tree):
        if node.kind == "when":
            yield from terms(condition_of(node))


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


@dataclass(frozen=True, slots=True)
class Limits:
    """The largest tree that is allowed; a `use` counts expanded."""

    max_depth: int  # levels, >= 1
    max_nodes: int  # nodes, >= 1


def within(node: Node, limits: Limits) -> bool:
    """Whether a tree keeps its limits."""
    return depth(node) <= limits.max_depth and size(node) <= limits.max_nodes


def check_limits(node: Node, limits: Limits) -> None:
    """Raises LimitError for a tree that is too deep or too large."""
    for what, found, most in (
        ("levels", depth(node), limits.max_depth),
        ("nodes", size(node), limits.max_nodes),
    ):
        if found > most:
            raise LimitError(
                f"Expected a tree of at most {most} {what}, found {found};"
                " shorten it or raise the limit."
            )
