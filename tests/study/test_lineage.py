"""Newcomers and their descendants, on a family tree laid out by hand."""

from __future__ import annotations

import pytest

from islandgp.gp.population import Origin
from islandgp.study.lineage import (
    Descent,
    Newcomer,
    alive,
    descent_of_first,
    elite_share,
    first_descendant,
    median_life,
    newcomers,
)
from tests.study.fake_runs import fake_run, individual

# 0.0 and 0.1 are the initial population. 1.1 is injected, 2.1 random.
# 2.0 descends from 1.1, and 3.0 from 2.0; 2.1 has no children.
POPULATIONS = [
    [individual("0.0", "random"), individual("0.1", "random")],
    [individual("1.0", "crossover", ["0.0", "0.1"]), individual("1.1", "injected")],
    [individual("2.0", "crossover", ["1.0", "1.1"]), individual("2.1", "random")],
    [
        individual("3.0", "elite", ["2.0"], fitness=9.0),
        individual("3.1", "copy", ["1.0"], fitness=5.0),
    ],
]


def test_survival_and_descendants() -> None:
    """The injected tree lives two generations in two descendants; the random one has none."""
    injected, random = newcomers(fake_run(best=[1.0] * 4, populations=POPULATIONS))
    assert (injected.origin, injected.generation) == (Origin.INJECTED, 1)
    assert (injected.lived, injected.watched, injected.descendants) == (2, 2, 2)
    assert (random.origin, random.lived, random.descendants) == (Origin.RANDOM, 0, 0)


def test_initial_individuals_are_no_newcomers() -> None:
    """Only trees that came later count: the initial population has no rivals to survive."""
    assert {n.generation for n in newcomers(fake_run(best=[1.0] * 4, populations=POPULATIONS))} == {
        1,
        2,
    }


def test_share_of_the_final_elite() -> None:
    """The best of the last generation descends from the injected tree, not from the random one."""
    run = fake_run(best=[1.0] * 4, populations=POPULATIONS)
    assert elite_share(run, Origin.INJECTED) == 1.0
    assert elite_share(run, Origin.RANDOM) == 0.0


def test_a_line_that_comes_back_has_lived_on() -> None:
    """A resurrected ancestor's line counts until its last descendant."""
    populations = [
        [individual("0.0", "random")],
        [individual("1.0", "injected")],
        [individual("2.0", "random")],
        [individual("3.0", "resurrected", ["1.0"])],
    ]
    injected = newcomers(fake_run(best=[1.0] * 4, populations=populations))[0]
    assert (injected.lived, injected.descendants) == (2, 1)


def _newcomer(lived: int, watched: int) -> Newcomer:
    return Newcomer("1.0", Origin.INJECTED, 1, 0.0, lived, watched, lived)


def test_kaplan_meier_by_hand() -> None:
    """Lives 0 and 2 of three ended, the third was cut off at 1: 1, 2/3, 2/3, 0."""
    newcomers = [_newcomer(0, 9), _newcomer(2, 9), _newcomer(1, 1)]
    assert alive(newcomers, 4) == pytest.approx([1, 2 / 3, 2 / 3, 0])
    assert median_life(newcomers, 4) == 3
    # One that came in the last generation was never at risk: of one line at risk one ended.
    assert alive([_newcomer(0, 0), _newcomer(0, 9)], 2) == [1, 0]
    assert alive([_newcomer(2, 2), _newcomer(2, 9), _newcomer(5, 9)], 4) == [1, 1, 1, 0.5]
    assert median_life([_newcomer(1, 1)], 4) is None


@pytest.mark.parametrize(
    ("origin", "mutation", "parents", "source"),
    [
        ("injected", "", [], Descent.INJECTED),
        ("injected", "swap", [], Descent.MUTATED),
        ("crossover", "", ["1.1"], Descent.DESCENDANT),
        ("crossover", "", ["1.0"], Descent.OWN),
    ],
)
def test_where_the_first_one_came_from(
    origin: str, mutation: str, parents: list[str], source: Descent
) -> None:
    """Given as it was, given and mutated, descended, or found without any injected tree."""
    first = individual("2.0", origin, parents, mutation=mutation, tiers=("complete",))
    run = fake_run(best=[1.0] * 3, populations=[POPULATIONS[0], POPULATIONS[1], [first]])
    assert descent_of_first(run, "complete") is source
    assert descent_of_first(run, "excellent") is Descent.NEVER


def test_advised_trees_are_no_descendants() -> None:
    """Neither the injected tree nor its unchanged copy counts; its mutated copy does."""
    complete = {"tiers": ("complete",)}
    populations = [
        [individual("0.0", "random")],
        [individual("1.0", "injected", **complete)],
        [individual("2.0", "elite", ["1.0"], **complete)],
        [individual("3.0", "copy", ["2.0"], mutation="point", tree="PatrolWaypoint\n", **complete)],
    ]
    run = fake_run(best=[1.0] * 4, populations=populations)
    assert first_descendant(run, "complete") == 3
    assert first_descendant(run, "excellent") is None


@pytest.mark.parametrize(("mutation", "first"), [("edit:front", None), ("edit:front+point", 1)])
def test_an_edited_tree_counts_only_if_it_was_mutated(mutation: str, first: int | None) -> None:
    """Neither the edited tree nor its elite; the mutation of an edited tree is "edit:KIND"."""
    complete = {"tiers": ("complete",)}
    populations = [
        [individual("0.0", "random")],
        [individual("1.0", "edited", ["0.0"], mutation=mutation, **complete)],
        [individual("2.0", "elite", ["1.0"], **complete)],
    ]
    run = fake_run(best=[1.0] * 3, populations=populations)
    assert first_descendant(run, "complete") == first
