"""Controls without evolution: the trees that a supervisor knows, alone in the runs' own worlds.

Whoever injects trees of a library could hand them out as they are. So each of them has one
episode in each generation's world, under its stage's multipliers, and what evolution adds is
the difference of a run's highest fitness to the best of these trees.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from islandgp.evaluation.base import Evaluator, Job, Problem
from islandgp.study import library
from islandgp.study.arms import Comparison
from islandgp.study.generalise import problem_of


@dataclass(frozen=True, slots=True)
class Control:
    """A tree that nobody evolves, in the worlds of the runs."""

    name: str  # of the library's tree
    given: bool  # it is one that supervisors inject, not only a yardstick
    fitness: Mapping[int, tuple[float, ...]]  # points in each generation, by the runs' seed


def controls(study: Comparison, make: Callable[[Problem], Evaluator]) -> tuple[Control, ...]:
    """The library's trees and its yardsticks in the worlds of the first arm's runs.

    Raises:
        EvaluationError: an episode cannot be run.
        StudyError: the domain's class cannot be imported.
    """
    runs = study.arms[0].runs
    configs = [arm.runs[0].config for arm in study.arms]
    trees = {text: (name, True) for c in configs for name, text in library.given(c).items()}
    for name, text in library.yardsticks(runs[0].config).items():
        trees.setdefault(text, (name, False))
    places = {run.seed: [(r.snapshot.stage, r.worlds[0]) for r in run.records] for run in runs}
    jobs = {
        text: [Job(text, stage, world) for row in places.values() for stage, world in row]
        for text in trees
    }
    evaluator = make(problem_of(runs[0]))
    try:
        wanted = list(dict.fromkeys(job for mine in jobs.values() for job in mine))
        outcomes = evaluator.evaluate(wanted)
    finally:
        evaluator.close()
    points = {job: o.fitness for job, o in zip(wanted, outcomes, strict=True)}
    return tuple(
        Control(
            name,
            given,
            {
                seed: tuple(points[Job(text, stage, world)] for stage, world in row)
                for seed, row in places.items()
            },
        )
        for text, (name, given) in trees.items()
    )


def best_of(found: Sequence[Control], seed: int) -> tuple[float, ...]:
    """The highest fitness of the library's trees in each generation of a seed's runs, points."""
    return tuple(map(max, zip(*(c.fitness[seed] for c in found if c.given), strict=True)))
