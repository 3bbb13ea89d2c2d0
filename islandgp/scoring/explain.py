"""Explains a tree: what each of its nodes does over several worlds, and what is lost without it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from islandgp.bt.analysis.shorter import removable, without
from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import (
    FAILURE,
    SUCCESS,
    Node,
    as_subtree,
    commented,
    names_of,
    size,
    walk,
)
from islandgp.bt.core.printer import with_subtrees
from islandgp.domain import Observer, Outcome, Scene
from islandgp.plain import NanAsNull
from islandgp.statistics import mean_interval
from islandgp.text import in_points

Evaluate = Callable[[Sequence[Node], Sequence[int]], list[list[Outcome]]]
"""(trees, world seeds) -> the outcomes of each tree in each world."""

Run = Callable[[Node, int, Observer | None], Outcome]
"""Runs the episode of a tree in the world of a seed, with an observer if there is one."""


@dataclass(frozen=True, slots=True)
class NodeLoss:
    """Points that a tree loses without a node: means of paired differences, with a 95 % interval.

    Negative points are a gain.
    """

    mean: float
    low: NanAsNull
    high: NanAsNull


@dataclass(frozen=True, slots=True)
class NodeUsage:
    """What one node does in an episode: means over the worlds. A guard runs if its child does."""

    worlds: float  # share of the worlds in which it ran, 0 to 1
    ticks: float  # in which it ran
    successes: float
    failures: float
    aborts: float  # how often it was running and was stopped
    points: float  # that the actions below it earned
    loss: NodeLoss | None = None  # without the node; None: it cannot be removed alone


class _Counter:
    """An observer that counts the statuses of each node, and the points of each action."""

    scenes = False

    def __init__(self, tree: Node) -> None:
        self.tree = tree
        self.counts = [[0.0] * 5 for _ in range(size(tree))]  # by node and status
        self.points = [0.0] * size(tree)  # by leaf
        self._leaf = {place: node.action for place, node in enumerate(walk(tree)) if node.action}
        self._last: dict[str, int] = {}  # by action: the leaf that was ticked last

    def node(self, place: int, status: int) -> None:
        """See `Observer`."""
        self.counts[place][status] += 1
        if place in self._leaf and status != ABORTED:
            self._last[self._leaf[place]] = place

    def credit(self, component: str, points: float, event: str, action: str) -> None:  # noqa: ARG002 -- see `Observer`
        """See `Observer`."""
        if action in self._last:
            self.points[self._last[action]] += float(points)

    def tick(self, board: Sequence[float], scene: Scene | None) -> None:
        """See `Observer`."""


def usage(run: Run, tree: Node, worlds: Sequence[int]) -> list[NodeUsage]:
    """What each node of a tree does, in document order.

    Args:
        run: runs an episode.
        tree: with actions and keys of the domain.
        worlds: at least one seed.

    Returns:
        One entry per node, without losses.
    """
    counters = [_Counter(tree) for _ in worlds]
    for counter, seed in zip(counters, worlds, strict=True):
        run(tree, seed, counter)
    nodes = list(walk(tree))
    usages = []
    for place, node in enumerate(nodes):
        inside = place
        while nodes[inside].guard is not None:
            inside += 1  # the child of a guard follows it
        counts = [counter.counts[inside] for counter in counters]
        end = place + size(node)  # its descendants come before
        usages.append(
            NodeUsage(
                worlds=fmean(any(own) for own in counts),
                ticks=fmean(sum(own[:ABORTED]) for own in counts),
                successes=fmean(own[SUCCESS] for own in counts),
                failures=fmean(own[FAILURE] for own in counts),
                aborts=fmean(own[ABORTED] for own in counts),
                points=fmean(sum(counter.points[inside:end]) for counter in counters),
            )
        )
    return usages


def with_losses(
    usages: Sequence[NodeUsage],
    tree: Node,
    evaluate: Evaluate,
    worlds: Sequence[int],
    leave_out: Collection[int] = (),
) -> list[NodeUsage]:
    """Adds what the tree loses without each node.

    Args:
        usages: of the nodes in document order.
        tree: theirs.
        evaluate: runs episodes.
        worlds: at least one seed.
        leave_out: places of nodes that get no loss.

    Returns:
        The usages; those of nodes that cannot be removed alone have no loss.
    """
    shorter = {
        place: form
        for place in removable(tree)
        if place not in leave_out and (form := without(tree, {place}))
    }
    original, *outcomes = evaluate([tree, *shorter.values()], worlds)
    losses = {
        place: NodeLoss(
            *mean_interval([a.fitness - b.fitness for a, b in zip(original, own, strict=True)])
        )
        for place, own in zip(shorter, outcomes, strict=True)
    }
    return [replace(u, loss=losses.get(place)) for place, u in enumerate(usages)]


def in_words(u: NodeUsage) -> str:
    """One line on a node's usage, for comments and tables."""
    if not u.worlds:
        return "never runs"
    parts = [f"runs in {u.worlds:.0%} of worlds"]
    if u.points:
        parts.append(f"earns {in_points(u.points)}")
    if u.loss is not None:
        interval_text = (
            f" [{in_points(-u.loss.high, '+')}, {in_points(-u.loss.low, '+')}]"
            if u.loss.low == u.loss.low
            else ""
        )
        parts.append(f"without it {in_points(-u.loss.mean, '+')}{interval_text}")
    return ", ".join(parts)


def with_counts(u: NodeUsage) -> str:
    """One line on a node's usage, with its ticks and results in an episode."""
    counts = f"{u.ticks:,.0f} ticks, {u.successes:,.0f} succeeded, {u.failures:,.0f} failed; "
    return (counts if u.worlds else "") + in_words(u)


def explained(
    tree: Node, usages: Sequence[NodeUsage], words: Callable[[NodeUsage], str] = in_words
) -> Node:
    """The tree with a comment above each branch.

    A branch is a child of a selector, or an inner node, that can be removed alone.
    """
    places = iter(usages)

    def visit(node: Node, is_branch: bool) -> Node:
        mine = next(places)
        selects = kind_of(node).advance_status == FAILURE
        children = tuple([visit(child, selects) for child in node.children])
        shown = mine.loss is not None and (is_branch or bool(children))
        inner = Node(node.kind, node.args, children)
        for name in reversed(names_of(node)):
            inner = as_subtree(inner, name)
        return commented(inner, [words(mine)] if shown else [])

    return visit(tree, False)


def explained_in_text(run: Run, tree: Node, worlds: Sequence[int]) -> str:
    """A tree's text with a comment on each child of a selector."""
    nodes = list(walk(tree))
    selectors = {id(c) for n in nodes if kind_of(n).advance_status == FAILURE for c in n.children}
    others = {place for place, node in enumerate(nodes) if id(node) not in selectors}

    def evaluate(trees: Sequence[Node], seeds: Sequence[int]) -> list[list[Outcome]]:
        return [[run(each, seed, None) for seed in seeds] for each in trees]

    usages = with_losses(usage(run, tree, worlds), tree, evaluate, worlds, others)
    return with_subtrees(explained(tree, usages, with_counts))
