"""Evaluates the best trees in unseen worlds, and the library's trees in the worlds of the runs.

A run chooses its best robot in its own validation worlds. Here the best robots of all runs are
evaluated in the same unseen worlds, in the last stage.

A supervisor may inject library trees that are good without evolution. So each library tree has one
episode in each generation's world, under the stage's multipliers. The difference of a run's highest
fitness to the best library tree is the effect of evolution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from statistics import fmean
from typing import Final

from pydantic import ValidationError

from islandgp.domain import Outcome
from islandgp.errors import RunError, StudyError, UntrustedError
from islandgp.evaluation.base import Evaluator, Job, Problem
from islandgp.evolution.validation import validation_seeds
from islandgp.scoring.classes import tiers
from islandgp.seeding import Stream
from islandgp.statistics import Interval, paired_difference
from islandgp.study import library
from islandgp.study.arms import Comparison, Run
from islandgp.study.lineage import most_injected

REFERENCE_WORLDS: Final = 100
"""Minimum number of worlds of a reference tree."""


@dataclass(frozen=True, slots=True)
class Generalisation:
    """The results of a tree in unseen worlds."""

    arm: str  # or the name of a reference tree
    seed: int | None  # of the run whose best robot it is; None: a reference tree
    trained: float | None  # points, in training
    points: tuple[float, ...]  # in each unseen world, in the same order for all trees
    reached: Mapping[str, float]  # share of the worlds in which it reaches a milestone
    perturbed: tuple[float, ...] = ()  # points in these worlds after their perturbation, if any

    @property
    def worlds(self) -> int:
        """Number of unseen worlds."""
        return len(self.points)

    @property
    def unseen(self) -> float:
        """Points, mean over the worlds."""
        return fmean(self.points)

    @property
    def worst(self) -> float:
        """Points, lowest of the worlds."""
        return min(self.points)

    def minus(self, other: Generalisation) -> Interval:
        """Mean difference to another tree in the worlds that both met, with its 95 % interval."""
        n = min(self.worlds, other.worlds)
        return paired_difference(self.points[:n], other.points[:n])


def champions_by_arm(results: Iterable[Generalisation]) -> dict[str, list[Generalisation]]:
    """The results of best robots by arm, without arms that have none."""
    champions: dict[str, list[Generalisation]] = {}
    for g in results:
        if g.seed is not None:
            champions.setdefault(g.arm, []).append(g)
    return champions


def unseen_worlds(study: Comparison, n: int) -> tuple[int, ...]:
    """The first n world seeds of a separate stream that no run of the study used.

    They differ from those of `islandgp play`, which are 0, 1, 2, ...
    """
    runs = [run for arm in study.arms for run in arm.runs]
    used_worlds = {world for run in runs for record in run.records for world in record.worlds}
    used_worlds |= {world for run in runs for world in run.validation}
    return validation_seeds(0, frozenset(used_worlds), n, Stream.UNSEEN)


def reference_trees(study: Comparison) -> dict[str, str]:
    """The library's reference trees, and the library tree that was injected most often, if any.

    Canonical texts by name; the names contain a colon, which names of arms cannot.
    """
    config = study.arms[0].runs[0].config
    texts = {f"library: {name}": text for name, text in library.reference_trees(config).items()}
    often = most_injected(study.arms)
    if often is not None:
        name, text, times = often
        texts[f"injected {times:,} times: {name}"] = text
    return texts


def generalise(
    study: Comparison,
    make: Callable[[Problem], Evaluator],
    *,
    worlds: int,
    reference_trees: Mapping[str, str],
    reference_worlds: int = REFERENCE_WORLDS,
) -> tuple[Generalisation, ...]:
    """Evaluates each run's best robot, and reference trees, in the same unseen worlds.

    The world settings are those of the first arm, so trees are comparable even if the arms have
    different ones.

    Args:
        study: the comparison.
        make: creates an evaluator.
        worlds: world seeds for the best robots.
        reference_trees: canonical texts by name.
        reference_worlds: world seeds for the reference trees; they include `worlds`.

    Raises:
        EvaluationError: an episode cannot be run.
        StudyError: the domain's class cannot be imported.
    """
    problem = problem_of(study.arms[0].runs[0])
    seeds = unseen_worlds(study, max(worlds, reference_worlds))
    stage = len(problem.curriculum.stages) - 1
    runs = [(arm.name, run) for arm in study.arms for run in arm.runs]
    champions = [(name, run.seed, run.champion.record) for name, run in runs]
    trees = [
        (name, seed, record.fitness, [Job(record.tree, stage, world) for world in seeds[:worlds]])
        for name, seed, record in champions
    ] + [
        (name, None, None, [Job(text, stage, world) for world in seeds])
        for name, text in reference_trees.items()
    ]
    outcomes = _outcomes(make(problem), (job for *_, arm_jobs in trees for job in arm_jobs))
    perturbed = _perturbed(study, make, [job for *_, arm_jobs in trees for job in arm_jobs])
    results = []
    for name, seed, trained, arm_jobs in trees:
        reached = [tiers(outcomes[job], study.classes) for job in arm_jobs]
        results.append(
            Generalisation(
                arm=name,
                seed=seed,
                trained=trained,
                points=tuple(outcomes[job].fitness for job in arm_jobs),
                reached={m: fmean(m in t for t in reached) for m in study.milestones},
                perturbed=tuple(perturbed[job].fitness for job in arm_jobs if perturbed),
            )
        )
    return tuple(results)


def _perturbed(
    study: Comparison, make: Callable[[Problem], Evaluator], jobs: Sequence[Job]
) -> dict[Job, Outcome]:
    """The outcomes in the first arm's perturbed worlds; {} without a perturbation."""
    run = study.arms[0].runs[0]
    if run.config.get("perturb") is None:
        return {}
    return _outcomes(make(problem_of(run, perturbed=True)), jobs)


def _outcomes(evaluator: Evaluator, jobs: Iterable[Job]) -> dict[Job, Outcome]:
    """The outcome of each job; equal jobs are run once."""
    with closing(evaluator):
        distinct = list(dict.fromkeys(jobs))
        return dict(zip(distinct, evaluator.evaluate(distinct), strict=True))


def problem_of(run: Run, *, perturbed: bool | None = None) -> Problem:
    """The problem of a run; `perturbed` as in `Problem.recorded`.

    Raises:
        StudyError: its domain cannot be imported.
        UntrustedError: only the run names its domain.
    """
    try:
        return Problem.recorded(run.config, perturbed=perturbed)
    except UntrustedError:
        raise
    except RunError as error:
        cause = error.__cause__
        message = cause.errors()[0]["msg"] if isinstance(cause, ValidationError) else error
        raise StudyError(
            f"Expected to find the domain {run.flat['domain.factory']} here, found"
            f" {message}; install it, or leave the unseen worlds out with"
            " --worlds 0."
        ) from error


@dataclass(frozen=True, slots=True)
class Control:
    """A library tree evaluated in the worlds of the runs."""

    name: str  # of the library's tree
    injectable: bool  # True: supervisors can inject it; False: a reference tree only
    fitness: Mapping[int, tuple[float, ...]]  # points in each generation, by seed


def controls(study: Comparison, make: Callable[[Problem], Evaluator]) -> tuple[Control, ...]:
    """The library's trees and its reference trees in the worlds of the first arm's runs.

    Raises:
        EvaluationError: an episode cannot be run.
        StudyError: the domain's class cannot be imported.
    """
    runs = study.arms[0].runs
    configs = [arm.runs[0].config for arm in study.arms]
    trees = {
        text: (name, True) for c in configs for name, text in library.trees_for_targets(c).items()
    }
    for name, text in library.reference_trees(runs[0].config).items():
        trees.setdefault(text, (name, False))
    places = {run.seed: [(r.snapshot.stage, r.worlds[0]) for r in run.records] for run in runs}
    jobs = {
        text: {seed: [Job(text, *place) for place in row] for seed, row in places.items()}
        for text in trees
    }
    all_jobs = (job for by_seed in jobs.values() for row in by_seed.values() for job in row)
    outcomes = _outcomes(make(problem_of(runs[0])), all_jobs)
    return tuple(
        Control(
            name,
            from_library,
            {seed: tuple(outcomes[job].fitness for job in row) for seed, row in jobs[text].items()},
        )
        for text, (name, from_library) in trees.items()
    )


def best_of(trees: Sequence[Control], seed: int) -> tuple[float, ...]:
    """The highest fitness of the library's trees in each generation of a seed's runs, points."""
    return tuple(map(max, zip(*(c.fitness[seed] for c in trees if c.injectable), strict=True)))
