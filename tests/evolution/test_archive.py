"""The archive of elites: its grid, how elites are displaced, and what a run keeps of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from statistics import fmean
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from islandgp.domain import Outcome
from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.evolution.loop import evolve
from islandgp.gp.archive import (
    EDGES,
    ArchiveSettings,
    ArchiveUpdate,
    Elite,
    archive_record,
    cell_of,
    update_archive,
)
from islandgp.gp.population import Evaluated
from islandgp.search.racing import Racing
from islandgp.seeding import Stream, seed_of
from tests.composed import composed, composed_plan
from tests.evolution.fake import Fake
from tests.evolution.runs import SMALL, Constant, lines, plan, records, run
from tests.profiles import sweep
from tests.samples import CLASSES, evaluated, outcome

GRID = ArchiveSettings(cells={"pickups": (0, 1, 3)})
TREES = ("PatrolWaypoint", "SeekCharger", "PickupGarbage", "MoveToGarbage")


def some(*rows: tuple[str, float, float], generation: int = 0) -> list[Evaluated]:
    """Individuals of (tree, pickups, fitness)."""
    return [
        evaluated(f"{generation}.{slot}", outcome(fitness, pickups=pickups), tree=tree)
        for slot, (tree, pickups, fitness) in enumerate(rows)
    ]


def no_reevaluation(trees: Sequence[str]) -> list[list[Outcome]]:
    """Fail: the archive must not evaluate trees again."""
    raise AssertionError(trees)


def after(
    before: Sequence[Elite],
    individuals: Sequence[Evaluated],
    settings: ArchiveSettings = GRID,
    *,
    world: int = 1,
    stage: int = 0,
    reevaluate: Any = no_reevaluation,
) -> ArchiveUpdate:
    """The archive after a generation of one episode in one world."""
    axes = settings.axes(CLASSES)
    elites = [
        (
            Elite(
                cell_of(e.outcome.counters, axes),
                e.individual.id,
                f"{e.individual.tree.args[0]}\n",
                stage,
                1,
                e.fitness,
                world,
            ),
            False,
        )
        for e in individuals
    ]
    means = lambda trees: [fmean(o.fitness for o in row) for row in reevaluate(trees)]  # noqa: E731 -- of this test
    return update_archive(before, elites, axes, settings, means)


@pytest.mark.parametrize(
    ("pickups", "cell"),
    [(-1, 0), (0, 0), (0.5, 0), (1, 1), (2.99, 1), (3, 2), (1e9, 2), (float("inf"), 2)],
)
def test_cells_begin_at_their_edges(pickups: float, cell: int) -> None:
    """A cell contains its edge and all values below the next; the outer cells are unbounded."""
    assert cell_of({"pickups": pickups}, {"pickups": (0.0, 1.0, 3.0)}) == (cell,)


@given(st.lists(st.floats(allow_nan=False), min_size=2, max_size=2))
def test_every_value_has_a_cell(values: list[float]) -> None:
    """For any counters the place is on the grid."""
    axes = {"a": (0.0, 1.0), "b": EDGES}
    cell = cell_of(dict(zip(axes, values, strict=True)), axes)
    assert all(0 <= place < len(edges) for place, edges in zip(cell, axes.values(), strict=True))


def test_the_best_of_each_cell() -> None:
    """An empty archive takes the fittest individual of each cell, the first of equals."""
    archive = after(
        (),
        some(("PatrolWaypoint", 0, 5), ("SeekCharger", 0, 7), ("PickupGarbage", 2, -4),
             ("MoveToGarbage", 2, -4)),
    )  # fmt: skip
    assert [(e.cell, e.id, e.tree, e.mean, e.episodes) for e in archive.elites] == [
        ((0,), "0.1", "SeekCharger\n", 7, 1),
        ((1,), "0.2", "PickupGarbage\n", -4, 1),
    ]
    assert asdict(archive.record) == {
        "coverage": 2 / 3,
        "qd_score": 7.0,
        "new": 2,
        "improved": 0,
    }
    assert archive.episodes == 0


def test_the_floor_of_the_qd_score() -> None:
    """The QD score sums what each mean has above the floor; below it an elite adds nothing."""
    archive = after((), some(("PatrolWaypoint", 0, 5), ("SeekCharger", 1, -7)))
    axes = GRID.axes(CLASSES)
    assert archive_record(archive.elites, axes, floor=-10).qd_score == 15 + 3
    assert archive_record(archive.elites, axes, floor=4).qd_score == 1
    assert archive_record((), axes, floor=-10).qd_score == 0


def test_only_the_better_displaces() -> None:
    """Without `again` a higher fitness displaces an elite at once; an equal one does not."""
    before = after((), some(("PatrolWaypoint", 0, 5))).elites
    equal = after(before, some(("SeekCharger", 0, 5), generation=1), world=2)
    assert (equal.elites, equal.record.improved) == (before, 0)
    better = after(before, some(("SeekCharger", 0, 6), generation=1), world=2)
    assert [(e.id, e.mean) for e in better.elites] == [("1.0", 6)]
    assert (better.record.new, better.record.improved) == (0, 1)


def test_a_mean_of_all_episodes() -> None:
    """An elite that is evaluated again is worth the mean, and keeps its id and its cell."""
    before = after((), some(("PatrolWaypoint", 0, 9))).elites
    (elite,) = after(before, some(("PatrolWaypoint", 3, 3), generation=1), world=2).elites
    assert (elite.id, elite.cell, elite.episodes, elite.mean) == ("0.0", (0,), 2, 6)


def test_a_lucky_elite_falls() -> None:
    """An elite whose mean sinks in a generation can be displaced in the same one."""
    before = after((), some(("PatrolWaypoint", 0, 9))).elites
    rows = (("PatrolWaypoint", 0, -9), ("SeekCharger", 0, 1))
    (elite,) = after(before, some(*rows, generation=1), world=2).elites
    assert (elite.tree, elite.mean) == ("SeekCharger\n", 1)


def test_the_same_episode_counts_once() -> None:
    """If the worlds do not change, an elite's mean counts the same episode once."""
    before = after((), some(("PatrolWaypoint", 0, 9), ("PatrolWaypoint", 0, 9))).elites
    assert after(before, some(("PatrolWaypoint", 0, 9), generation=1)).elites == before


@pytest.mark.parametrize(("points", "keeper"), [(5.0, "0.0"), (8.0, "1.0")])
def test_evaluated_again_before_it_displaces(points: float, keeper: str) -> None:
    """Both meet the same further episodes; the higher mean of all episodes keeps the cell."""
    before = after((), some(("PatrolWaypoint", 0, 6))).elites
    requests: list[Sequence[str]] = []

    def evaluate(trees: Sequence[str]) -> list[list[Outcome]]:
        requests.append(trees)
        return [[outcome(6.0), outcome(6.0)], [outcome(points), outcome(2.0)]]

    settings = replace_settings(reevaluations=2)
    archive = after(
        before, some(("SeekCharger", 0, 9), generation=1), settings, world=2, reevaluate=evaluate
    )
    assert requests == [["PatrolWaypoint\n", "SeekCharger\n"]]
    (elite,) = archive.elites
    mean = (9 + points + 2) / 3 if keeper == "1.0" else 6
    assert (elite.id, elite.episodes, elite.mean) == (keeper, 3, mean)
    assert (archive.episodes, archive.record.improved) == (4, int(keeper == "1.0"))


def replace_settings(**changes: Any) -> ArchiveSettings:
    """The settings of GRID with changes."""
    return ArchiveSettings(**{**GRID.model_dump(), **changes})


def test_an_empty_cell_is_taken_at_once() -> None:
    """Without an elite in the cell there is no re-evaluation."""
    archive = after((), some(("PatrolWaypoint", 0, 6)), replace_settings(reevaluations=3))
    assert (len(archive.elites), archive.episodes) == (1, 0)


def test_a_later_stage_displaces_an_earlier_one() -> None:
    """A tree of a later stage displaces an elite of an earlier stage with any number of points."""
    before = after((), some(("PatrolWaypoint", 0, 900), ("SeekCharger", 3, 800))).elites
    archive = after(
        before, some(("MoveToGarbage", 0, 1), ("SeekCharger", 3, 2), generation=1), stage=1
    )
    assert [(e.id, e.stage, e.episodes, e.mean) for e in archive.elites] == [
        ("1.0", 1, 1, 1),
        ("0.1", 1, 1, 2),
    ]


def test_an_elite_of_an_earlier_stage_is_tried_in_this_one() -> None:
    """With re-evaluation an elite of an earlier stage can stay, by its new episodes alone."""
    before = after((), some(("PatrolWaypoint", 0, 900))).elites
    (elite,) = after(
        before,
        some(("SeekCharger", 0, 1), generation=1),
        replace_settings(reevaluations=1),
        stage=1,
        reevaluate=lambda _: [[outcome(50.0)], [outcome(30.0)]],
    ).elites
    assert (elite.id, elite.stage, elite.episodes, elite.mean) == ("0.0", 1, 1, 50)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ({"pickups": [0]}, "at least 2"),
        ({"pickups": [0, 2, 2]}, r"rising edges of pickups, found \[0, 2, 2\]"),
        ({"pickups": [0, float("nan")]}, "finite"),
        ({c: [0, 1] for c in list(SCHEMA.counters)[:5]}, "at most 4 counters, found 5"),
        ({c: list(range(11)) for c in list(SCHEMA.counters)[:4]}, "10,000 cells in all, found 14,"),
    ],
)
def test_wrong_grids(cells: dict[str, list[float]], message: str) -> None:
    """A grid that cannot be, or is too large, is refused."""
    with pytest.raises(ValidationError, match=message):
        ArchiveSettings.model_validate({"cells": cells})


def test_the_grid_of_a_domain() -> None:
    """Where no cells are given, the behaviours' counters make the grid, four of them at most."""
    settings = composed()
    axes = settings.archive.axes(settings.classes)
    assert axes == dict.fromkeys(("pickups", "interactions", "charges", "deliveries"), EDGES)
    classes = settings.classes.model_copy(
        update={"behaviours": {f"b{i}": f"c{i // 2}" for i in range(12)}}
    )
    assert list(settings.archive.axes(classes)) == ["c0", "c1", "c2", "c3"]
    (line,) = ArchiveSettings(cells={"odd": (0, 1)}).faults(SCHEMA)
    assert line.startswith("archive.cells.odd: expected one of pickups, ")


def test_searches_and_their_challenges() -> None:
    """The paper's run costs what it did; other searches evaluate before they displace."""
    assert composed().archive.reevaluations == 0
    assert composed("search=racing").archive.reevaluations == 1
    assert composed("search=racing", "archive.reevaluations=3").archive.reevaluations == 3


def test_every_run_keeps_one() -> None:
    """Coverage never falls, the last record is that of the last archive, and no cell is twice."""
    steps = run()
    archive_records = [record.archive for record in records(steps)]
    assert all(record is not None for record in archive_records)
    shares = [record.coverage for record in archive_records if record]
    assert shares == sorted(shares)
    elites, run_plan = steps[-1].archive, plan()
    axes = run_plan.archive.axes(run_plan.classes)
    assert [e.cell for e in elites] == sorted({e.cell for e in elites})
    assert len({e.tree for e in elites}) == len(elites)
    last = archive_record(elites, axes, floor=0)
    assert archive_records[-1] is not None
    assert (archive_records[-1].coverage, archive_records[-1].qd_score) == (
        last.coverage,
        last.qd_score,
    )


def test_it_watches_only() -> None:
    """For any settings of the archive the populations are the same."""
    one, other = (
        run(plan(*overrides))
        for overrides in ((), ("archive.reevaluations=3", "archive.cells={pickups:[0,2]}"))
    )
    assert [r.individuals for r in records(one)] == [r.individuals for r in records(other)]
    assert len(other[-1].archive) <= 2


def test_worlds_and_costs_of_challenges() -> None:
    """Worlds of challenges have a separate stream; they count as the generation's episodes."""
    evaluator = Fake()
    run_plan = plan("archive.reevaluations=2", "archive.cells={pickups:[0,1]}")
    steps = run(run_plan, evaluator=evaluator)
    batches = iter(evaluator.batches)
    challenged = 0
    for g, step in enumerate(steps):
        assert len(next(batches)) == 12
        extra = step.cost.episodes - 12
        if extra:
            challenged += 1
            jobs = next(batches)
            assert len(jobs) == extra
            expected = {seed_of(1, Stream.ARCHIVE, generation=g, slot=i) for i in range(2)}
            assert {job.seed for job in jobs} == expected
    assert challenged > 1


@sweep("overrides", [("search=racing", "archive.reevaluations=2"), ()], quick=1)
def test_resumed_from_any_state(overrides: tuple[str, ...]) -> None:
    """A run that goes on from any of its states keeps the same archive."""
    settings = composed(*SMALL, *overrides)
    run_plan = composed_plan(*SMALL, *overrides)
    if overrides:
        racing: Any = settings.search.settings()
        search = Racing(racing, run_plan, [])

        def go(start: Any = None) -> list[Any]:
            return list(evolve(run_plan, 1, Constant(), Fake(), search=search, start=start))
    else:

        def go(start: Any = None) -> list[Any]:
            return run(run_plan, start=start)

    straight = go()
    expected = list(lines(straight))
    for at, step in enumerate(straight[:-1], 1):
        resumed = go(step.state)
        assert list(lines(resumed)) == expected[at:]
        assert resumed[-1].archive == straight[-1].archive


def test_a_state_without_an_archive_gets_an_empty_one() -> None:
    """A run goes on from a state of a version without archives, with an empty one."""
    step = run()[3]
    assert step.state is not None
    resumed = run(start=replace(step.state, archive=()))
    assert resumed[0].record.archive is not None
    assert resumed[0].record.individuals == run()[4].record.individuals
