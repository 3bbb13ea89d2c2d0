"""Controls without evolution: library trees in the worlds of the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from islandgp.domain import Outcome
from islandgp.evaluation.base import Job, Problem
from islandgp.study.comparable import compare_arms
from islandgp.study.generalise import best_of, controls
from islandgp.study.library import trees_for_targets
from islandgp.study.tables.champions import controls_table
from tests.samples import outcome
from tests.study.fake_runs import config, fake_arm, fake_run

TREES = trees_for_targets(config())


class Known:
    """An evaluator in which the k-th tree of the library earns k thousand, and a stage one more."""

    simulated = 0

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.jobs: list[Job] = []

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.jobs += jobs
        points = {tree: 1000.0 * k for k, tree in enumerate(TREES.values(), 1)}
        return [outcome(fitness=points.get(j.tree, 50_000.0) + j.stage) for j in jobs]

    def close(self) -> None:
        """See `Evaluator`."""


def _study():  # type: ignore[no-untyped-def] # a Comparison
    arms = [
        fake_arm(name, [fake_run(name, s, generations=4) for s in (0, 1)])
        for name in ("expert", "baseline")
    ]
    return compare_arms(arms)


def test_each_tree_of_the_library_lives_in_the_runs_worlds_and_stages() -> None:
    """One episode for each tree, run and generation; the kinds of reference trees are distinct."""
    study, evaluators = _study(), list[Known]()

    def make(problem: Problem) -> Known:
        evaluators.append(Known(problem))
        return evaluators[0]

    trees = controls(study, make)
    assert [c.name for c in trees if c.injectable] == list(TREES)
    assert "all_rounder" in [c.name for c in trees if not c.injectable]
    pairs = {(j.stage, j.seed) for j in evaluators[0].jobs if j.tree == TREES["single_pickup"]}
    runs = study.arms[0].runs
    assert pairs == {(r.snapshot.stage, r.worlds[0]) for run in runs for r in run.records}
    assert len(evaluators[0].jobs) == len(set(evaluators[0].jobs))
    stages = [r.snapshot.stage for r in runs[0].records]
    assert best_of(trees, 0) == tuple(1000.0 * len(TREES) + stage for stage in stages)


def test_the_table_shows_what_evolution_adds() -> None:
    """The difference of a run's highest fitness to the best of the library, seed by seed."""
    study = _study()
    trees = controls(study, Known)
    table = controls_table(study, trees)
    assert [row[0] for row in table.rows][:3] == [
        "expert",
        "baseline",
        "best of the library, not evolved",
    ]
    bests = [s.best for s in study.arms[0].runs[0].snapshots]
    added = sum(bests) / 4 - sum(best_of(trees, 0)) / 4
    assert (
        f"{added:+,.0f}".replace("-", "\N{MINUS SIGN}") in table.rows[0][-1]
        or f"{added:+,.0f}" in table.rows[0][-1]
    )


def test_an_arm_of_other_seeds_has_no_paired_difference() -> None:
    """Its runs met other worlds."""
    study = _study()
    trees = controls(study, Known)
    others = replace(
        study.arms[1], runs=tuple(fake_run("baseline", s, generations=4) for s in (5, 6))
    )
    table = controls_table(replace(study, arms=(study.arms[0], others)), trees)
    assert table.rows[0][-1] != table.rows[1][-1] == table.rows[2][-1]
