"""Best robots in unseen worlds, under the task of each arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from islandgp.compare.champions import (
    best_trees,
    champion_measures,
    evaluate_champions,
    library_trees,
    runs_of_one_task,
    unseen_worlds,
    with_champions,
)
from islandgp.compare.comparable import Comparison, compare_arms
from islandgp.domain import Outcome
from islandgp.errors import RunError
from islandgp.evaluation.base import Job, Problem
from islandgp.evaluation.serial import Serial
from islandgp.records.folder import RunFolder
from islandgp.seeding import Stream, stream
from tests.compare.fake_runs import TREE, config, fake_arm, fake_run, individual, validated, written
from tests.samples import outcome

OTHER = "PatrolWaypoint\n"


class Recorder:
    """An evaluator that gives a world's place as fitness, from 0, and keeps what it was asked."""

    def __init__(self, setting: Problem) -> None:
        self.setting = setting
        self.jobs: list[Job] = []
        self.closed = False

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.jobs += jobs
        place = {seed: k for k, seed in enumerate(dict.fromkeys(j.seed for j in jobs))}
        return [
            outcome(fitness=float(k), pickups=2, interactions=1, deliveries=1, charges=k)
            for k in (place[j.seed] for j in jobs)
        ]

    def close(self) -> None:
        """See `Evaluator`."""
        self.closed = True


def _study() -> Comparison:
    arms = [
        fake_arm(name, [fake_run(name, s, generations=4) for s in (0, 1)])
        for name in ("expert", "baseline")
    ]
    return compare_arms(arms)


def test_every_champion_meets_the_same_unseen_worlds_in_the_last_stage() -> None:
    """One result a run and one a library tree; equal trees are simulated once."""
    recorders: list[Recorder] = []

    def make(setting: Problem) -> Recorder:
        recorders.append(Recorder(setting))
        return recorders[-1]

    results = evaluate_champions(_study(), make, worlds=3, trees={OTHER: "a tree"})
    assert [*results["arm"]] == ["expert", "expert", "baseline", "baseline", "a tree"]
    assert [*results["seed"]][:4] == [0, 1, 0, 1]
    (recorder,) = recorders
    assert {j.tree for j in recorder.jobs} == {TREE, OTHER}
    assert len(recorder.jobs) == 3 + 3
    assert {j.stage for j in recorder.jobs} == {3}
    assert recorder.closed
    first = results.iloc[0]
    assert (first["points"], first["worst"]) == (1.0, 0.0)
    assert (first["reached.complete"], first["reached.excellent"]) == (2 / 3, 0.0)
    assert first["counters.charges"] == 1.0


def test_every_champion_is_scored_under_every_task() -> None:
    """Rewards of 100 and 1,000 a takeover: the same episodes, other points, in a cross table."""
    robot = individual("0.0", tree=next(iter(library_trees(config()))))
    arms = [
        fake_arm(
            f"arm{base}",
            [
                fake_run(
                    seed=s,
                    generations=4,
                    populations=[[robot]] * 4,
                    path=f"{base}-{s}",
                    rewards__events__interaction__base=base,
                    world__episode__length=200,
                )
                for s in (0, 1)
            ],
            f"rewards.events.interaction.base={base}",
        )
        for base in (100, 1000)
    ]
    study = compare_arms(arms)
    results = evaluate_champions(study, Serial, worlds=4, trees={})
    points = results.set_index(["arm", "seed", "task"])["points"]
    assert len(points) == 2 * 2 * 2
    assert [*results["own"]] == [
        *(results["task"] == results["arm"].str.replace("arm", "interaction.base="))
    ]
    low, high = (task.label for task in study.tasks)
    for arm in ("arm100", "arm1000"):
        assert points[arm, 0, high] > points[arm, 0, low]
        assert points[arm, 0, low] == points["arm100", 0, low]
    runs, measures = with_champions(study, results), champion_measures(study)
    assert measures[0].label == "Best robot in unseen worlds under interaction.base=100"
    assert runs[measures[1].key].iloc[0] == points["arm100", 0, high]


def test_unseen_worlds_are_of_a_stream_of_their_own() -> None:
    """They come from a separate stream, the same for all, and not from 0 as in `play`."""
    study = _study()
    seeds = unseen_worlds(study, 100)
    assert seeds[:3] == unseen_worlds(study, 3)
    assert len(set(seeds)) == 100
    assert min(seeds) > 100_000
    assert seeds[0] == int(stream(0, Stream.UNSEEN).integers(2**32))


def test_worlds_of_runs_are_passed_over() -> None:
    """A world that any run of the study used, also for validation, is not unseen."""
    study = _study()
    first, second, third = unseen_worlds(study, 3)
    run = fake_run("baseline", 2, generations=4)
    records = [replace(record, worlds=(second,)) for record in RunFolder(run.path).generations()]
    met = written(run.path / "met", records, run.config, validation=validated(1.0, first))
    arms = (study.arms[0], replace(study.arms[1], runs=(*study.arms[1].runs, met)))
    assert unseen_worlds(compare_arms(arms), 1) == (third,)


def test_library_trees_are_beside_the_best_robots() -> None:
    """Reference trees first, then those for targets."""
    names = [*library_trees(config()).values()]
    assert names[:2] == ["library: all_rounder", "library: multi_behaviour"]
    assert len(names) > 2


def test_the_best_by_validation_are_tested_in_worlds_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Equal trees once, runs without a validation last, and no more than there may be."""
    monkeypatch.setattr("islandgp.compare.champions.MOST", 3)
    records = [*RunFolder(fake_run(generations=4).path).generations()]
    for name, tree, mean in (
        ("a", "PatrolWaypoint\n", 5.0),
        ("b", "SeekCharger\n", 7.0),
        ("c", "SeekCharger\n", 6.0),
        ("d", "ExecuteCharge\n", None),
        ("e", "PickupGarbage\n", 1.0),
    ):
        result = None if mean is None else validated(mean, 9)
        best = individual("0.0", tree=tree)
        written(tmp_path / name, records, config(), champion=best, validation=result)
    recorders: list[Recorder] = []

    def make(setting: Problem) -> Recorder:
        recorders.append(Recorder(setting))
        return recorders[-1]

    rows = best_trees(runs_of_one_task(tmp_path), make, 2)
    assert [*rows[rows["evolved"]]["name"]] == ["b", "a", "e"]
    assert rows["name"].iloc[-1].startswith("library: ")
    assert rows["difference"].iloc[0] == 0
    used = {world for record in records for world in record.worlds} | {9}
    assert not used & {job.seed for job in recorders[0].jobs}


def test_runs_of_two_tasks_have_no_best_robot(tmp_path: Path) -> None:
    """Their points are not worth the same; nor is there one of no run."""
    records = [*RunFolder(fake_run(generations=4).path).generations()]
    with pytest.raises(RunError, match="Expected a finished run in"):
        runs_of_one_task(tmp_path)
    written(tmp_path / "a", records, config())
    written(tmp_path / "b", records, config(world__side=200))
    with pytest.raises(RunError, match="Expected runs with the same world, found different ones"):
        runs_of_one_task(tmp_path)
