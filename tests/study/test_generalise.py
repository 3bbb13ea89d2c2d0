"""Best robots in unseen worlds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from islandgp.domain import Outcome
from islandgp.errors import StudyError
from islandgp.evaluation.base import Job, Problem
from islandgp.seeding import Stream, stream
from islandgp.study.comparable import compare_arms
from islandgp.study.generalise import Generalisation, generalise, reference_trees, unseen_worlds
from islandgp.study.library import library_names
from islandgp.study.select import parse_arm
from islandgp.study.tables.champions import generalisation_table
from tests.samples import outcome
from tests.study.fake_runs import TREE, config, fake_arm, fake_run, guidance

HALF = {"complete": 0.5, "excellent": 0.5}


class Recorder:
    """An evaluator that gives a world's place as fitness, from 0, and keeps what it was asked."""

    simulated = 0

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


def _study():  # type: ignore[no-untyped-def] # a Comparison
    arms = [
        fake_arm(name, [fake_run(name, s, generations=4) for s in (0, 1)])
        for name in ("expert", "baseline")
    ]
    return compare_arms(arms)


def test_every_champion_meets_the_same_unseen_worlds_in_the_last_stage() -> None:
    """One summary a run and one a reference tree; equal trees are simulated once."""
    recorders: list[Recorder] = []

    def make(setting: Problem) -> Recorder:
        recorders.append(Recorder(setting))
        return recorders[0]

    results = generalise(
        _study(), make, worlds=3, reference_trees={"a tree": "PatrolWaypoint\n"}, reference_worlds=5
    )
    assert [(g.arm, g.seed) for g in results] == [
        ("expert", 0),
        ("expert", 1),
        ("baseline", 0),
        ("baseline", 1),
        ("a tree", None),
    ]
    jobs = recorders[0].jobs
    assert {j.tree for j in jobs} == {TREE, "PatrolWaypoint\n"}
    assert len(jobs) == 3 + 5
    assert [g.worlds for g in results] == [3, 3, 3, 3, 5]
    assert results[-1].unseen == (0 + 1 + 2 + 3 + 4) / 5
    assert {j.stage for j in jobs} == {3}
    assert recorders[0].closed
    assert (results[0].unseen, results[0].worst) == (1.0, 0.0)
    assert results[0].reached == {"complete": 2 / 3, "excellent": 0.0}


def test_unseen_worlds_are_those_of_nobody() -> None:
    """They come from a separate stream, the same for all, and not from 0 as in `play`."""
    study = _study()
    seeds = unseen_worlds(study, 100)
    assert seeds[:3] == unseen_worlds(study, 3)
    assert len(set(seeds)) == 100
    assert min(seeds) > 100_000
    assert seeds[0] == int(stream(0, Stream.UNSEEN).integers(2**32))


def test_worlds_of_runs_are_passed_over() -> None:
    """A world that any run of the study used is not unseen."""
    study = _study()
    first, second, third = unseen_worlds(study, 3)
    arm = study.arms[1]
    record = replace(arm.runs[0].records[0], worlds=(second,))
    met = replace(arm, runs=(replace(arm.runs[0], records=(record,)), arm.runs[1]))
    assert unseen_worlds(replace(study, arms=(study.arms[0], met)), 2) == (first, third)
    validated = replace(arm, runs=(replace(arm.runs[0], validation=(first, third)), arm.runs[1]))
    assert unseen_worlds(replace(study, arms=(study.arms[0], validated)), 1) == (second,)


def test_reference_trees_are_library_trees_by_name() -> None:
    """Those that the configuration names, and the library tree that was injected most often."""
    assert list(reference_trees(_study())) == ["library: all_rounder", "library: multi_behaviour"]
    texts = {name: text for text, name in library_names(config()).items()}
    guided = [
        guidance(tree=texts[name], injected=injected)
        for name, injected in (
            ("diverse", True),
            ("poor", True),
            ("poor", True),
            ("diverse", False),
        )
    ]
    runs = [fake_run(seed=k, generations=4, guided=g) for k, g in enumerate(guided)]
    study = _study()
    trees = reference_trees(replace(study, arms=(replace(study.arms[0], runs=tuple(runs)),)))
    assert trees["injected 6 times: poor"] == texts["poor"]
    assert len(trees) == 3


def test_an_arm_may_have_a_reference_tree_s_name() -> None:
    """An arm called hand-written keeps its row, and the reference tree has its own."""
    results = (
        Generalisation("hand-written", 0, 9_000.0, (5_000.0,) * 30, HALF),
        Generalisation("hand-written", 1, 9_000.0, (7_000.0,) * 30, HALF),
        Generalisation("hand-written", None, None, (1_000.0,) * 100, HALF),
    )
    rows = [row[:5] for row in generalisation_table(results, 30).rows]
    assert [(row[0], row[1], row[2]) for row in rows] == [
        ("hand-written", "2", "30"),
        ("hand-written", "1", "100"),
    ]
    assert rows[0][4].startswith("6,000")
    with pytest.raises(StudyError, match="Expected --arm"):
        parse_arm("library: all_rounder=supervisor=expert")
