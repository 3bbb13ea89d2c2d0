"""The best trees of a finished run or sweep, compared in worlds that neither made nor chose any."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from statistics import fmean
from typing import Final

from islandgp.compare.library import reference_trees
from islandgp.errors import ConfigError, RunError
from islandgp.evaluation.base import Evaluator, Problem, evaluated
from islandgp.evaluation.perturbation import recorded_perturbation
from islandgp.evolution.candidates import Candidate, CandidatesByFitness
from islandgp.evolution.validation import validate, validation_seeds
from islandgp.intervals import interval
from islandgp.records.folder import RunFolder
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import Constraints, feasible_share, recorded_constraints
from islandgp.seeding import Stream

EFFORT: Final = 20
"""Episodes of successive halving for each of --worlds."""


@dataclass(frozen=True, slots=True)
class Row:
    """A tree in the test worlds."""

    name: str
    mean: float  # points, mean over the worlds
    low: float  # 95 % interval of the mean
    high: float
    reached: dict[str, float]  # by milestone: share of the worlds
    difference: float  # points, mean of the paired differences to the first row
    difference_low: float  # its 95 % interval
    difference_high: float
    evolved: bool  # False: a tree of the library
    tree: str
    feasible: float | None = None  # share of the worlds in which it keeps all constraints
    perturbed: float | None = None  # points, mean over the worlds after their perturbation
    perturbed_worst: float | None = None  # points, the lowest of these


def best_rows(
    runs: Sequence[RunFolder], make: Callable[[Problem], Evaluator], tier: str, worlds: int
) -> list[Row]:
    """The rows: the winner first, and then by mean in validation worlds."""
    config = runs[0].configuration()
    classes, seed = Classes.model_validate(config["classes"]), int(config["seed"])
    if tier and tier not in classes.tiers:
        raise ConfigError(f"--tier: expected one of {', '.join(classes.tiers)}, found {tier!r}")
    constraints = recorded_constraints(config)
    contenders = _candidates(runs, classes, tier, constraints)
    used_worlds = frozenset(world for run in runs for world in _used_worlds(run))
    stage = max(record["snapshot"]["stage"] for run in runs for record in run.records())
    episodes = EFFORT * worlds
    race = validation_seeds(seed, used_worlds, episodes)
    test = validation_seeds(seed, used_worlds.union(race), worlds, Stream.TEST)
    perturbed = None
    with closing(make(Problem.recorded(config))) as evaluator:
        finalists = validate(
            contenders, race, evaluator, stage, classes, episodes=episodes, constraints=constraints
        )
        names = _names(runs, [candidate for candidate, _ in finalists[:3]])
        library = {tree: f"library: {name}" for name, tree in reference_trees(config).items()}
        labels = names | {tree: name for tree, name in library.items() if tree not in names}
        outcomes = evaluated(evaluator, list(labels), stage, test)
    if recorded_perturbation(config) is not None:
        with closing(make(Problem.recorded(config, perturbed=True))) as evaluator:
            perturbed = evaluated(evaluator, list(labels), stage, test)
    rows = []
    for k, (tree, label) in enumerate(labels.items()):
        reached = [tiers(outcome, classes) for outcome in outcomes[k]]
        pairs = zip(outcomes[k], outcomes[0], strict=True)
        after = [outcome.fitness for outcome in perturbed[k]] if perturbed else []
        row = Row(
            label,
            *interval([outcome.fitness for outcome in outcomes[k]]),
            {m: fmean(m in r for r in reached) for m in classes.milestones},
            *interval([own.fitness - first.fitness for own, first in pairs]),
            tree in names,
            tree,
            feasible_share([o.counters for o in outcomes[k]], constraints) if constraints else None,
            fmean(after) if after else None,
            min(after, default=None),
        )
        rows.append(row)
    return rows


def _names(runs: Sequence[RunFolder], best: Sequence[Candidate]) -> dict[str, str]:
    """The names of the run's or sweep's trees, by text."""
    names: dict[str, str] = {}
    for candidate in best:
        names.setdefault(candidate.tree, candidate.id)
    if len(runs) == 1:
        champion = runs[0].summary()["champion"]
        name = names.get(champion["tree"], champion["record"]["id"])
        names[champion["tree"]] = f"{name}, the run's best robot"
    return names


def _candidates(
    runs: Sequence[RunFolder], classes: Classes, tier: str, constraints: Constraints
) -> list[Candidate]:
    """All trees of a run's last stage, or the best robot of each run of a sweep."""
    if len(runs) == 1:
        everyone = CandidatesByFitness(
            classes, most=sys.maxsize, top=sys.maxsize, tier=tier, constraints=constraints
        )
        if not (trees := everyone.best_of(runs[0].records())):
            raise RunError(
                f"Expected {tier} robots in the last stage of {runs[0].path}, found none."
            )
        return trees
    if tier:
        raise ConfigError("--tier: expected a run's own folder with it, found a sweep's")
    best: dict[str, Candidate] = {}
    for run in runs:
        champion = run.summary()["champion"]
        record = champion["record"]
        name = f"{run.path.name}, {record['id']}"
        new = Candidate(champion["generation"], name, champion["tree"], record["fitness"])
        best.setdefault(new.tree, new)
    return list(best.values())


def _used_worlds(run: RunFolder) -> Iterator[int]:
    """The worlds of a run's training, choice and test."""
    for record in run.records():
        yield from record["worlds"]
    champion = run.summary()["champion"]
    yield from champion["chosen_in"]
    if champion["validation"] is not None:
        yield from champion["validation"]["worlds"]
