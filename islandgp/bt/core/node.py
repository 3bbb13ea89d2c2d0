"""Nodes of Behaviour Trees with their arguments, and limits of trees (section 2.2.3).

`kinds` declares the kinds of nodes; a domain declares actions and blackboard keys (`vocabulary`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.core.condition import Condition, ConditionExpr, combine, opposite, terms
from islandgp.errors import LimitError

# Statuses are plain integers because a tick is the innermost loop of a run.
FAILURE: Final = 0
SUCCESS: Final = 1
RUNNING: Final = 2
AGAIN: Final = 3
"""RUNNING, and the next tick is required.

RUNNING lets a simulator skip ticks: as long as no condition changes its truth and each running
action stays RUNNING, a tick would only resume the same actions. A node returns AGAIN instead if its
next tick may do something else although nothing changes: a repetition is due, a node counts ticks,
or a reactive composite starts its earlier children again. The caller must then tick the tree in the
next step. Composites and decorators pass AGAIN on like RUNNING; logs, exports and
`STATUS_NAMES` show it as RUNNING. An action never returns it.
"""

STATUS_NAMES: Final = ("FAILURE", "SUCCESS", "RUNNING", "RUNNING")

Value: TypeAlias = float | str
"""The value of an action's argument: a number, a word or a text; a flag is `yes` or `no`."""


class ActionArgs(NamedTuple):
    """Arguments of a leaf."""

    name: str  # of the action
    values: tuple[tuple[str, Value], ...] = ()  # (argument, value) of the action


class GuardArgs(NamedTuple):
    """Arguments of a `when`."""

    condition: ConditionExpr
    abort: str = "both"  # a key of ABORTS

    @property
    def checks_itself(self) -> bool:
        """True if the guard stops its own child when its condition becomes false."""
        return self.abort in ("self", "both")

    @property
    def interrupts(self) -> bool:
        """True if the guard stops later branches, provided that a composite observes it."""
        return self.abort in ("lower", "both")


COUNTS: Final = (1, 1_000_000)  # fewest and most repetitions, or children that decide
SECONDS: Final = (0.001, 100_000)  # shortest and longest time, in s


class CountArgs(NamedTuple):
    """Arguments of a repeater or a retry."""

    times: float | str  # a whole number within COUNTS, or a key


class SecondsArgs(NamedTuple):
    """Arguments of a wait, a timeout or a cooldown."""

    seconds: float | str  # of the domain's clock, within SECONDS, or a key


Policy: TypeAlias = str | float
"""Number of children that decide a parallel: a key of POLICIES, or a whole number >= 1."""


class ParallelArgs(NamedTuple):
    """Arguments of a parallel."""

    success: Policy = "all"  # number of children that must succeed
    failure: Policy = "one"  # number of children that must fail

    def needed(self, children: int) -> tuple[int, int]:
        """The numbers of successes and failures that end a parallel of `children` children."""
        success, failure = (
            {"one": 1, "all": children}[policy] if isinstance(policy, str) else int(policy)
            for policy in self
        )
        return min(success, children), min(failure, children)


class AlwaysArgs(NamedTuple):
    """Arguments of an `always`."""

    status: str  # success, failure or running


class SetArgs(NamedTuple):
    """Arguments of a `set`."""

    assigned: Condition  # with the operator =


class WrittenArgs(NamedTuple):
    """A `use`, `for`, `switch` or case as it is written; an expanded tree has no such node."""

    head: str  # before its brace


Args: TypeAlias = (
    tuple[()]
    | ActionArgs
    | GuardArgs
    | CountArgs
    | SecondsArgs
    | ParallelArgs
    | AlwaysArgs
    | SetArgs
    | WrittenArgs
)


class Node(NamedTuple):
    """One node of a Behaviour Tree; a tree is its root. Equal nodes are equal trees."""

    kind: str  # a key of KINDS
    args: Args = ()  # an instance of KINDS[kind].args
    children: tuple[Node, ...] = ()

    @property
    def action(self) -> str:
        """The name of a leaf's action; "" for an inner node."""
        return self.args.name if isinstance(self.args, ActionArgs) else ""

    @property
    def guard(self) -> GuardArgs | None:
        """The arguments of a `when`; None for any other node."""
        return self.args if isinstance(self.args, GuardArgs) else None


def guard_of(node: Node) -> GuardArgs:
    """The arguments of a node that is a `when`."""
    assert node.guard is not None
    return node.guard


def count_of(node: Node) -> float:
    """The count of a node whose kind counts; infinite without one, or if it is a key."""
    times = node.args.times if isinstance(node.args, CountArgs) else inf
    return inf if isinstance(times, str) or times == inf else int(times)


def leaf(name: str) -> Node:
    """A leaf; its action's arguments have their defaults."""
    return Node("action", ActionArgs(name))


def guarded(condition: ConditionExpr, child: Node, abort: str = "both") -> Node:
    """A `when` above a node."""
    return Node("when", GuardArgs(condition, abort), (child,))


def selector(*children: Node) -> Node:
    """A selector of these branches."""
    return Node("selector", (), children)


def sequence(*children: Node) -> Node:
    """A sequence of these branches."""
    return Node("sequence", (), children)


def switch(tests: Sequence[ConditionExpr], branches: Sequence[Node]) -> Node:
    """Guards of branches, one for each condition; a last branch runs while none of them holds."""
    guards = [guarded(test, branch) for test, branch in zip(tests, branches, strict=False)]
    if len(branches) > len(tests):
        guards.append(guarded(opposite(combine("or", tests)), branches[-1], "self"))
    return selector(*guards)


Place: TypeAlias = tuple[str, int, int]  # the name of a file, a line and a column, both from 1


class Comments(NamedTuple):
    """The comments around a node, each with its `#`; "" is a blank line."""

    above: tuple[str, ...] = ()  # on lines above its head
    aside: tuple[str, ...] = ()  # at the end of the line of its head
    inside: tuple[str, ...] = ()  # on lines above its closing brace
    end: tuple[str, ...] = ()  # behind its closing brace

    @property
    def lines(self) -> tuple[str, ...]:
        """The texts of all of them."""
        return tuple(filter(None, (line.strip("# ") for part in self for line in part)))


class NodeMark(NamedTuple):
    """Where a node is written or, with a name, the `use` that inserts it."""

    name: str = ""  # as after `use`: `recharge(20, 3)`
    place: Place = ("", 1, 1)
    comments: Comments = Comments()


_UNMARKED: Final = NodeMark()


class MarkedNode(Node):
    """A node with its places, comments and names; equal to the same node without them."""

    marks: tuple[NodeMark, ...] = (_UNMARKED,)
    """A mark for each subtree whose root it is where it is used, the outermost first (several if
    a subtree consists of another one only), and last its own."""


def marked(node: Node, *marks: NodeMark) -> MarkedNode:
    """The node with other marks."""
    result = MarkedNode._make(node)
    result.marks = marks
    return result


def as_subtree(node: Node, name: str, use: NodeMark = _UNMARKED) -> MarkedNode:
    """The node as the root of a subtree, around those that it is already the root of."""
    return marked(node, use._replace(name=name), *marks_of(node))


def commented(node: Node, comments: Sequence[str]) -> Node:
    """The node with these lines of comments above those that it already has."""
    if not comments:
        return node
    outer, *inner = marks_of(node)
    above = (*(f"# {line}" for line in comments), *outer.comments.above)
    return marked(node, outer._replace(comments=outer.comments._replace(above=above)), *inner)


def marks_of(node: Node) -> tuple[NodeMark, ...]:
    """The marks of a node; a single empty one if it has none."""
    return node.marks if isinstance(node, MarkedNode) else (_UNMARKED,)


def names_of(node: Node) -> tuple[str, ...]:
    """The names of the subtrees whose root this is; the outermost first."""
    return tuple([mark.name for mark in marks_of(node)[:-1]])


def walk(node: Node) -> Iterator[Node]:
    """Iterates over the nodes of a tree in document order (parents before their children)."""
    pending = [node]  # the next node is the last
    while pending:
        node = pending.pop()
        yield node
        pending += node.children[::-1]


def with_above(node: Node, above: tuple[Node, ...] = ()) -> Iterator[tuple[Node, tuple[Node, ...]]]:
    """The nodes of a tree in document order, each with those above it from the root on."""
    yield node, above
    for child in node.children:
        yield from with_above(child, (*above, node))


def keys_of(args: Args) -> tuple[str, ...]:
    """The keys that a node with these arguments reads or writes, other than those of an action."""
    match args:
        case GuardArgs(condition):
            return tuple([key for term in terms(condition) for key in term.keys])
        case SetArgs(assigned):
            return assigned.keys
        case CountArgs(str(key)) | SecondsArgs(str(key)):
            return (key,)
    return ()


def keys_in(tree: Node) -> tuple[str, ...]:
    """The keys that a tree reads or writes, in document order, each once."""
    return tuple(dict.fromkeys(key for node in walk(tree) for key in keys_of(node.args)))


def written_in(tree: Node) -> frozenset[str]:
    """The keys that a tree writes."""
    sets = (node.args for node in walk(tree) if isinstance(node.args, SetArgs))
    return frozenset(args.assigned.key for args in sets)


def actions_in(tree: Node) -> set[str]:
    """The actions of a tree's leaves."""
    return {node.args.name for node in walk(tree) if isinstance(node.args, ActionArgs)}


def asked_in(tree: Node) -> Iterator[Condition]:
    """The single conditions of a tree's guards, in document order."""
    for node in walk(tree):
        if node.guard:
            yield from terms(node.guard.condition)


def thresholds(tree: Node, key: str) -> tuple[float, ...]:
    """The distinct numbers with which a tree compares a key, ascending.

    While the key's value stays strictly between two neighbours, no comparison changes its truth.
    """
    return tuple(sorted({t.number for t in asked_in(tree) if t.single and t.key == key}))


def compares_keys(tree: Node, key: str) -> bool:
    """True if a tree compares a key with another key, or calculates with it."""
    return any(not term.single and key in term.keys for term in asked_in(tree))


def size(node: Node) -> int:
    """Number of nodes, >= 1."""
    nodes = [node]
    for each in nodes:  # the list grows while it is iterated
        nodes += each.children
    return len(nodes)


def depth(node: Node) -> int:
    """Number of levels, >= 1: a single action has depth 1."""
    return size_and_depth(node)[1]


def size_and_depth(node: Node) -> tuple[int, int]:
    """Number of nodes and number of levels, in one pass."""
    nodes, levels, below = 1, 1, node.children
    while below:
        nodes += len(below)
        levels += 1
        below = tuple([child for each in below for child in each.children])
    return nodes, levels


def levels(tree: Node, level: int = 1) -> list[int]:
    """The level of each node, the root's being 1, in document order."""
    return [level, *(below for child in tree.children for below in levels(child, level + 1))]


def measured(tree: Node) -> list[tuple[Node, int, int]]:
    """Each node with its size and depth, in document order."""
    return [(node, *size_and_depth(node)) for node in walk(tree)]


def replace_at(tree: Node, index: int, new: Node) -> Node:
    """The tree with its node number `index` (document order, root 0) replaced by `new`."""
    if index == 0:
        return new
    index -= 1
    for i, child in enumerate(tree.children):
        n = size(child)
        if index < n:
            return spliced(tree, i, 1, replace_at(child, index, new))
        index -= n
    raise IndexError("expected an index below the tree's size")


def spliced(node: Node, at: int, gone: int, *new: Node) -> Node:
    """The node with `new` children in place of `gone` children from index `at` on."""
    children = node.children
    return node._replace(children=(*children[:at], *new, *children[at + gone :]))


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a tree's size; a `use` counts expanded."""

    max_depth: int  # levels, >= 1
    max_nodes: int  # nodes, >= 1


def within(node: Node, limits: Limits) -> bool:
    """True if a tree is within its limits."""
    nodes, levels = size_and_depth(node)
    return levels <= limits.max_depth and nodes <= limits.max_nodes


def check_limits(node: Node, limits: Limits) -> None:
    """Raises LimitError if a tree is too deep or too large."""
    if not within(node, limits):
        nodes, levels = size_and_depth(node)
        raise LimitError(
            f"Expected a tree of at most {limits.max_nodes} nodes and {limits.max_depth} levels,"
            f" found {nodes} nodes and {levels} levels; shorten it or raise the limit."
        )
