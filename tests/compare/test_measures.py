"""What a run is measured by."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from islandgp.compare.figures import at_episodes
from islandgp.compare.measures import (
    FITNESS,
    SPANS,
    best,
    episodes_until,
    first,
    first_descendant,
    training_measures,
    with_advised_ancestor,
)
from islandgp.compare.runs import Run
from islandgp.gp.record import Cost
from tests.compare.fake_runs import fake_arm, fake_run, individual
from tests.samples import CLASSES


def test_table_9_by_hand() -> None:
    """Highest ever, highest of the last generation, mean of the highest, last mean."""
    run = fake_run(best=[1.0, 5.0, 3.0])
    assert [m.of(run) for m in FITNESS[:4]] == [5.0, 3.0, 3.0, 100.0]


def test_table_10_by_hand() -> None:
    """A stage's value is the mean of its generations' highest fitness."""
    run = fake_run(best=[float(g) for g in range(41)])
    assert [m.of(run) for m in FITNESS[4:]] == [5.0, 18.0, 33.0]


@pytest.mark.parametrize("n", [4, 5, 6, 16, 41, 100])
def test_stages_cover_a_run_of_any_length(n: int) -> None:
    """Each generation belongs to one stage, in order, and no stage is empty."""
    assert [g for span in SPANS for g in span.generations(n)] == list(range(n))
    assert all(span.generations(n) for span in SPANS)


def test_the_family_is_the_paper_s() -> None:
    """Seven of Tables 9 and 10, two emergences, six of Table 12; the others are not main."""
    measures = training_measures(CLASSES)
    assert len({m.key for m in measures}) == len(measures) == 17
    assert [m.key for m in measures if m.emergence and m.main] == [
        "first_complete",
        "first_excellent",
    ]
    assert [m.key for m in measures if not m.main] == [
        "first_complete_descendant",
        "first_excellent_descendant",
    ]


def _run(*episodes: int, seed: int = 0, **changes: Any) -> Run:
    """A run whose generations asked for so many episodes, each as fit as its number."""
    run = fake_run("expert", seed, best=[float(g) for g in range(len(episodes))], **changes)
    return replace(run, costs=tuple(Cost(1.0, 0.0, 0.0, n, n) for n in episodes))


def test_episodes_are_those_of_the_costs() -> None:
    """Summed up to the end of each generation; lost ones are those of the configuration."""
    assert episodes_until(_run(30, 30, 10, 2)) == (30, 60, 70, 72)
    run = _run(0, 0, 5, gp__population=20, gp__episodes=3)
    assert episodes_until(run) == (60, 120, 125)


def test_curves_of_runs_with_unequal_episodes() -> None:
    """At each number of episodes that all runs have reached: the last finished generation."""
    places, rows = at_episodes(fake_arm("a", [_run(10, 10, 10), _run(15, 10, seed=1)]), best)
    assert places == [15, 20, 25]
    assert rows == [[0, 1, 1], [0, 0, 1]]


def test_an_advised_tree_is_no_descendant() -> None:
    """An injected robot and its copy do not count; the first that changed does."""
    populations = [
        [individual("0.0", "random")],
        [individual("1.0", "injected", tiers=("complete",))],
        [individual("2.0", "elite", ["1.0"], tiers=("complete",))],
        [individual("3.0", "crossover", ["2.0"], mutation="swap", tiers=("complete",))],
    ]
    run = fake_run(best=[1.0] * 4, populations=populations, complete=1)
    assert (first(run, "complete"), first_descendant(run, "complete")) == (1, 3)
    assert with_advised_ancestor(run) == {"1.0", "2.0", "3.0"}
