"""Explaining a tree: counts, points and losses of its nodes over several worlds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from statistics import fmean

import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, walk
from islandgp.bt.core.printer import with_subtrees
from islandgp.domain import Observer, Outcome
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.scoring.explain import (
    NodeLoss,
    NodeUsage,
    explained,
    explained_in_text,
    in_words,
    usage,
    with_losses,
)
from islandgp.viewer.recording import FAILED, STOPPED, SUCCEEDED, record
from tests.composed import composed
from tests.samples import outcome

TREE = parse(
    """
selector {
  when lap > 50 { SeekCharger }
  when foundGarbage { sequence { MoveToGarbage PickupGarbage } }
  PatrolWaypoint
}
""",
    VOCABULARY,
)


@pytest.fixture(scope="module")
def usages() -> list[NodeUsage]:
    """Of TREE on a short island, in two worlds."""
    return usage(composed("world.episode.length=60").problem().run(2), TREE, (3, 4))


def test_counts_are_those_of_recordings(usages: list[NodeUsage]) -> None:
    """Successes, failures and aborts are means of what a recording of each world has."""
    problem = composed("world.episode.length=60").problem()
    recordings = [record(TREE, problem, seed=seed, stage=2) for seed in (3, 4)]
    for place, node in enumerate(walk(TREE)):
        if node.guard is None:
            codes = [recording.statuses[place] for recording in recordings]
            assert usages[place].successes == fmean(c.count(SUCCEEDED) for c in codes)
            assert usages[place].failures == fmean(c.count(FAILED) for c in codes)
            # A node that is aborted and started again in one tick shows what came last.
            assert usages[place].aborts >= fmean(c.count(STOPPED) for c in codes)


def test_points_are_those_of_the_actions_below(usages: list[NodeUsage]) -> None:
    """A node earns what its children earn; a branch that never runs earns nothing."""
    root, never, _, garbage, *_ = usages
    assert root.points == pytest.approx(never.points + garbage.points + usages[-1].points)
    assert (never.worlds, never.ticks, never.points) == (0, 0, 0)
    assert in_words(never) == "never runs"
    assert garbage.worlds == 1
    assert garbage.points == usages[4].points > 0  # the guard has those of its child


def test_losses_are_paired_differences() -> None:
    """Without a node a tree has other points; nodes that cannot go alone have no loss."""

    def evaluate(trees: Sequence[Node], worlds: Sequence[int]) -> list[list[Outcome]]:
        picks = [any(n.action == "PickupGarbage" for n in walk(tree)) for tree in trees]
        return [[outcome(10.0 * (world + pick)) for world in worlds] for pick in picks]

    blank = [NodeUsage(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)] * 8
    losses = [u.loss for u in with_losses(blank, TREE, evaluate, (1, 2, 3))]
    none, ten = NodeLoss(0, 0, 0), NodeLoss(10, 10, 10)
    assert losses == [None, none, None, ten, None, none, ten, none]


def test_a_tree_with_comments_is_the_same_tree(usages: list[NodeUsage]) -> None:
    """Comments stand above branches that can be removed, and can be read again."""
    known = [
        NodeUsage(1.0, 1.0, 1.0, 0.0, 0.0, 1234.0, NodeLoss(-50.0, -70.0, -30.0)) for _ in usages
    ]
    text = with_subtrees(explained(TREE, known))
    assert parse(text, VOCABULARY) == TREE
    line = "  # runs in 100% of worlds, earns 1,234, without it +50 [+30, +70]"
    assert text.splitlines().count(line) == 3


def test_a_text_for_prompts() -> None:
    """Each child of a selector has a comment with its counts and its loss, by one episode more."""
    episodes = 0

    def run(tree: Node, seed: int, observer: Observer | None) -> Outcome:
        nonlocal episodes
        episodes += 1
        return problem.run(2)(tree, seed, observer)

    problem = composed("world.episode.length=60").problem()
    text = explained_in_text(run, TREE, [3])
    assert episodes == 5
    assert parse(text, VOCABULARY) == TREE
    assert text.count("#") == 3
    assert re.search(r"# \d+ ticks, \d+ succeeded, \d+ failed; .* without it [+-]", text)
    assert "# never runs" in text
