"""What a run is measured by."""

from __future__ import annotations

from typing import Any

import pytest

from islandgp.compare.arms import Run
from islandgp.compare.figures import by_run
from islandgp.compare.measures import FITNESS, POINTS, SPANS, measured, read_runs, training_measures
from islandgp.gp.record import GenerationRecord
from islandgp.records.folder import RunFolder
from tests.compare.fake_runs import fake_arm, fake_run, individual, written
from tests.samples import CLASSES


def values(run: Run) -> dict[str, Any]:
    """The measures of a run."""
    return dict(measured(read_runs([fake_arm("a", [run])])[0], CLASSES).iloc[0])


def test_table_9_by_hand() -> None:
    """Highest ever, highest of the last generation, mean of the highest, last mean."""
    found = values(fake_run(best=[1.0, 5.0, 3.0, 3.0]))
    assert [found[m.key] for m in FITNESS[:4]] == [5.0, 3.0, 3.0, 100.0]


def test_table_10_by_hand() -> None:
    """A stage's value is the mean of its generations' highest fitness."""
    found = values(fake_run(best=[float(g) for g in range(41)]))
    assert [found[m.key] for m in FITNESS[4:]] == [5.0, 18.0, 33.0]


@pytest.mark.parametrize("n", [4, 5, 6, 16, 41, 100])
def test_stages_cover_a_run_of_any_length(n: int) -> None:
    """Each generation belongs to one stage, in order, and no stage is empty."""
    assert [g for span in SPANS for g in span.generations(n)] == list(range(n))
    assert all(span.generations(n) for span in SPANS)


def test_the_family_is_the_paper_s() -> None:
    """Seven of Tables 9 and 10, two emergences, six of Table 12; the others are not main."""
    measures = training_measures(CLASSES)
    assert len({m.key for m in measures}) == len(measures) == 17
    assert [m.key for m in measures if m.emergence] == [
        *("first.complete", "first.excellent"),
        *("first_descendant.complete", "first_descendant.excellent"),
    ]
    assert [m.main for m in measures if m.emergence] == [True, True, False, False]
    assert sum(m.unit == POINTS for m in measures) == 7


def _run(*episodes: int, **changes: Any) -> Run:
    """A run whose generations took so many episodes, each as fit as its number."""
    run = fake_run(best=[float(g) for g in range(len(episodes))], **changes)
    records: list[GenerationRecord] = [*RunFolder(run.path).generations()]
    return written(run.path / "again", records, run.config, episodes=episodes)


def test_curves_of_runs_with_unequal_episodes() -> None:
    """At each number of episodes that all runs have reached: the last finished generation.

    Lost episodes are those of the configuration.
    """
    runs = [_run(10, 10, 10), _run(15, 0, seed=1, gp__population=5, gp__episodes=2)]
    curves = by_run(read_runs([fake_arm("a", runs)])[0], "until", "fitness_max")
    assert [*curves.index] == [15, 20, 25]
    assert sorted(map(list, curves.to_numpy().T)) == [[0, 0, 1], [0, 1, 1]]


def test_an_advised_tree_is_no_descendant() -> None:
    """An injected robot and its copy do not count; the first that changed does."""
    populations = [
        [individual("0.0", "random")],
        [individual("1.0", "injected", tiers=("complete",))],
        [individual("2.0", "elite", ["1.0"], tiers=("complete",))],
        [individual("3.0", "crossover", ["2.0"], mutation="swap", tiers=("complete",))],
    ]
    found = values(fake_run(best=[1.0] * 4, populations=populations, complete=1))
    assert (found["first.complete"], found["first_descendant.complete"]) == (1, 3)


OTHER = "PatrolWaypoint\n"
POOR = "MoveToGarbage\n"

# 1.1 is injected and kept as an elite; 2.1 is its child; 3.1 is a copy of a random tree.
POPULATIONS = [
    [individual("0.0", "random"), individual("0.1", "random", tree=OTHER)],
    [individual("1.0", "crossover", ["0.0", "0.1"]), individual("1.1", "injected", tree=POOR)],
    [
        individual("2.0", "elite", ["1.1"], tree=POOR, fitness=9.0),
        individual("2.1", "crossover", ["1.0", "1.1"]),
    ],
    [
        individual("3.0", "resurrected", ["2.0"], tree=POOR, fitness=5000.0),
        individual("3.1", "copy", ["0.1"], tree=OTHER),
        individual("3.2", "elite", ["1.0"]),
        individual("3.3", "elite", ["1.0"], mutation="swap"),
        individual("3.4", "elite", ["1.1"], mutation="swap", tree=OTHER),
        individual("3.5", "injected", mutation="swap"),
        individual("3.6", "edited", mutation="edit:insert"),
    ],
]


@pytest.mark.parametrize(
    ("place", "origin"),
    [
        (0, "injected"),
        (1, "a random tree"),
        (2, "bred"),
        (3, "bred"),
        (4, "bred, with an advised ancestor"),
        (5, "bred, with an advised ancestor"),
        (6, "edited by the supervisor"),
    ],
)
def test_copies_are_followed_back_to_where_the_tree_arose(place: int, origin: str) -> None:
    """Drawn, bred, or given as it is."""
    run = fake_run(best=[1.0, 1, 1, 2], populations=POPULATIONS)
    records = [*RunFolder(run.path).generations()]
    best = records[3].individuals[place]
    again = written(run.path / "again", records, run.config, champion=best)
    assert read_runs([fake_arm("a", [again])])[1]["origin"].item() == origin
