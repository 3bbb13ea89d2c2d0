"""Best robots and trees of the library in unseen worlds, under the task of every arm.

A run chooses its best robot in its own worlds, under its own rewards. Here the best robots of all
runs are evaluated in the same seeds of worlds that no run used, in the last stage, once under each
task: the world, rewards, curriculum and classes of some arms. Trees of the library are evaluated
too: a supervisor may inject trees that are good without evolution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean

from pydantic import ValidationError

from islandgp.compare import library
from islandgp.compare.comparable import Comparison
from islandgp.compare.measures import POINTS, Measure
from islandgp.compare.runs import Run
from islandgp.domain import Outcome
from islandgp.errors import RunError, StudyError, UntrustedError
from islandgp.evaluation.base import Evaluator, Job, Problem
from islandgp.evolution.validation import validation_seeds
from islandgp.scoring.classes import tiers
from islandgp.seeding import Stream

Make = Callable[[Problem], Evaluator]


@dataclass(frozen=True, slots=True)
class TreeResult:
    """The results of a tree in unseen worlds under a task."""

    arm: str  # or the name of a tree of the library
    run: Path | None  # whose best robot it is; None: a tree of the library
    seed: int | None  # of this run
    task: str  # label
    own: bool  # True: the task of its arm
    points: tuple[float, ...]  # in each world, in the same order for all trees
    reached: Mapping[str, float]  # share of the worlds in which it reaches a milestone
    counters: Mapping[str, float]  # means over the worlds
    perturbed: tuple[float, ...] = ()  # points in these worlds after their perturbation, if any

    @property
    def mean(self) -> float:
        """Points, mean over the worlds."""
        return fmean(self.points)


def unseen_worlds(study: Comparison, n: int) -> tuple[int, ...]:
    """The first n world seeds of a separate stream that no run of the study used.

    They differ from those of `islandgp play`, which are 0, 1, 2, ...
    """
    used = {w for _, run in study.runs for record in run.records for w in record.worlds}
    used |= {w for _, run in study.runs for w in run.validation}
    return validation_seeds(0, frozenset(used), n, Stream.UNSEEN)


def library_trees(study: Comparison) -> dict[str, str]:
    """Canonical texts of the library's trees by name: its reference trees, those for targets.

    Names contain a colon, unlike those of arms.
    """
    trees: dict[str, str] = {}
    for arm in study.arms:
        config = arm.runs[0].config
        for texts in (library.reference_trees(config), library.trees_for_targets(config)):
            for name, text in texts.items():
                trees.setdefault(text, f"library: {name}")
    return {name: text for text, name in trees.items()}


def evaluate_champions(
    study: Comparison, make: Make, *, worlds: int, trees: Mapping[str, str]
) -> tuple[TreeResult, ...]:
    """Evaluates each run's best robot, and further trees, in the same unseen worlds.

    Args:
        study: the comparison.
        make: creates an evaluator.
        worlds: number of world seeds.
        trees: texts of further trees by name.

    Raises:
        EvaluationError: an episode cannot be run.
        StudyError: the domain's class cannot be imported.
    """
    seeds = unseen_worlds(study, worlds)
    everyone: list[tuple[str, Run | None, str]] = [
        (arm.name, run, run.champion.record.tree) for arm, run in study.runs
    ]
    everyone += [(name, None, text) for name, text in trees.items()]
    results = []
    for task in study.tasks:
        problem, classes = problem_of(task.run), task.run.classes
        stage = len(problem.curriculum.stages) - 1
        jobs = {text: [Job(text, stage, world) for world in seeds] for _, _, text in everyone}
        every_job = [job for each in jobs.values() for job in each]
        outcomes = _outcomes(make(problem), every_job)
        perturbed: Mapping[Job, Outcome] = {}
        if task.run.config.get("perturb") is not None:
            perturbed = _outcomes(make(problem_of(task.run, perturbed=True)), every_job)
        for name, run, text in everyone:
            found = [outcomes[job] for job in jobs[text]]
            reached = [tiers(outcome, classes) for outcome in found]
            results.append(
                TreeResult(
                    arm=name,
                    run=None if run is None else run.path,
                    seed=None if run is None else run.seed,
                    task=task.label,
                    own=name in task.arms,
                    points=tuple(outcome.fitness for outcome in found),
                    reached={m: fmean(m in r for r in reached) for m in classes.milestones},
                    counters={c: fmean(o.counters[c] for o in found) for c in found[0].counters},
                    perturbed=tuple(perturbed[job].fitness for job in jobs[text] if perturbed),
                )
            )
    return tuple(results)


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


def champion_keys(study: Comparison) -> tuple[str, ...]:
    """The keys of `champion_measures`."""
    if len(study.tasks) == 1:
        return ("unseen",)
    counters = study.arms[0].runs[0].champion.record.counters
    tasks = (f"unseen_{k}" for k in range(1, len(study.tasks) + 1))
    return (*tasks, *(f"counters.{name}" for name in counters))


def champion_measures(study: Comparison, results: Sequence[TreeResult]) -> tuple[Measure, ...]:
    """Measures of the best robots: points under each task; with several tasks, also counters.

    A counter is the mean of a run's best robot in the worlds of its own task.
    """
    if not results:
        return ()
    several = len(study.tasks) > 1
    measures = []
    for k, task in enumerate(study.tasks, 1):
        points: dict[Path | None, float] = {
            r.run: r.mean for r in results if r.task == task.label and r.run
        }
        key = f"unseen_{k}" if several else "unseen"
        label = f"Best robot in unseen worlds{f' under {task.label}' if several else ''}"
        measures.append(Measure(key, label, POINTS, partial(_value, points)))
    own = {r.run: r.counters for r in results if r.own and r.run}
    for name in results[0].counters if several else ():
        values: dict[Path | None, float] = {path: counters[name] for path, counters in own.items()}
        label = f"{name} of the best robot, own task"
        measures.append(Measure(f"counters.{name}", label, "count", partial(_value, values)))
    return tuple(measures)


def _value(values: Mapping[Path | None, float], run: Run) -> float:
    return values[run.path]
