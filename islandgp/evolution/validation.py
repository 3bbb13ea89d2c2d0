"""Selects a run's best robot by successive halving on held-out seeds.

The highest fitness of a generation depends partly on its worlds, and stages have different scales.
So the most promising trees of the last stage are evaluated again in the same validation worlds, by
successive halving (Jamieson and Talwalkar 2016): each round drops half of the candidates and
evaluates the others in more worlds.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from statistics import fmean
from typing import Any, Final, TypeVar

from islandgp.domain import Outcome
from islandgp.evaluation.base import Evaluator, Job
from islandgp.gp.evidence import SHRINKAGE, estimate
from islandgp.intervals import interval
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import (
    NO_CONSTRAINTS,
    Constraints,
    Merit,
    feasible_share,
    limited,
    mean_violation,
    merit,
    running_mean,
    violation,
)
from islandgp.seeding import Stream, stream

T = TypeVar("T")

MAX_CANDIDATES: Final = 24  # candidates
FINALISTS: Final = 3  # candidates of the last round
WORLDS_EACH: Final = 5  # per candidate, if there are too few episodes for all candidates
TOP_PER_GENERATION: Final = 2  # candidates per generation
PART: Final = 100  # least generations of a part of a long run


@dataclass(frozen=True, slots=True)
class Candidate:
    """A candidate for the best robot."""

    generation: int
    id: str  # of the individual
    tree: str  # canonical text
    trained: float  # points, its fitness in its own generation
    violation: float = 0.0  # of the constraints in training, >= 0

    @property
    def merit(self) -> Merit:
        """Sort key before the first round: fewer constraint violations first, then fitness."""
        return merit(self.trained, self.violation)


@dataclass(frozen=True, slots=True)
class Validation:
    """Results of a tree in validation worlds."""

    worlds: tuple[int, ...]  # world seeds
    mean: float  # points, mean over the worlds
    low: float  # 95 % interval of the mean, Student's t
    high: float
    reached: dict[str, float]  # share of the worlds by tier
    yardstick: str = ""  # name of the reference tree, "" for none
    difference: float = 0.0  # points, mean of the paired differences to the reference tree
    difference_low: float = 0.0  # its 95 % interval
    difference_high: float = 0.0
    violation: float | None = None  # of the constraints, by the counters' means; None: none
    feasible: float | None = None  # share of the worlds in which all are kept; None: none


@dataclass(frozen=True, slots=True)
class Best:
    """A run's best robot."""

    generation: int
    record: Mapping[str, Any]  # the individual's, as plain values
    validation: Validation | None  # None: it was not validated


def candidates(
    records: Iterable[Mapping[str, Any]],
    classes: Classes,
    *,
    most: int = MAX_CANDIDATES,
    top: int = TOP_PER_GENERATION,
    tier: str = "",
    constraints: Constraints = NO_CONSTRAINTS,
) -> list[Candidate]:
    """The most promising distinct trees of the last stage.

    These are the best individuals of each generation and of each tier, class and behaviour.
    Individuals that keep the constraints come first, then the fittest.

    Args:
        records: generation records as plain values, oldest first; they are iterated once.
        classes: with the tiers, classes and behaviours.
        most: maximum number of candidates.
        top: number of candidates per generation.
        tier: in training, of all candidates; "": any.
        constraints: of the run.

    Returns:
        At most `most` candidates.
    """

    def keep(generation: int, i: Mapping[str, Any]) -> _Shown:
        counters = i["counters"]
        behaviours = {name for name, counter in classes.behaviours.items() if counters[counter] > 0}
        tree = sys.intern(i["tree"])  # elites are copies
        excess = violation(counters, constraints)
        candidate = Candidate(generation, i["id"], tree, i["fitness"], excess)
        return candidate, frozenset((*i["tiers"], i["specialist"], *behaviours))

    last = [pair for pair in _of_last_stage(records, keep) if not tier or tier in pair[1]]
    by_tree: dict[str, Candidate] = {}
    for candidate in _ordered(last, classes, top):
        by_tree.setdefault(candidate.tree, candidate)
    return list(by_tree.values())[:most]


_Shown = tuple["Candidate", frozenset[str]]
"""A candidate with its class, tiers and behaviours."""


def _of_last_stage(
    records: Iterable[Mapping[str, Any]], keep: Callable[[int, Mapping[str, Any]], T]
) -> list[T]:
    """`keep(generation, individual)` of all individuals of the last stage.

    Only these values are kept, as long runs have tens of thousands of individuals.
    """
    stage: int | None = None
    last: list[T] = []
    for record in records:
        now = record["snapshot"]
        if now["stage"] != stage:
            stage, last = now["stage"], []
        last += [keep(now["generation"], individual) for individual in record["individuals"]]
    return last


def candidates_by_evidence(
    records: Iterable[Mapping[str, Any]],
    *,
    most: int = MAX_CANDIDATES,
    bound_width: float = 1.0,
    constraints: Constraints = NO_CONSTRAINTS,
    shrinkage: float = SHRINKAGE,
) -> list[Candidate]:
    """The trees of the last stage with the highest lower bounds of their mean fitness.

    Trees that keep the constraints, by the means of their counters over all evaluations, come
    first. A run of at least 2 * PART generations is divided into parts with equal numbers of
    candidates: trees of distant generations did not meet the same worlds, so their levels cannot
    be compared.

    Args:
        records: generation records as plain values, oldest first; they are read once.
        most: maximum number of candidates.
        bound_width: standard errors between a tree's level (`evidence.estimate`) and its bound.
        constraints: of the run.
        shrinkage: as in `evidence.estimate`.

    Returns:
        Candidates, best first; `trained` is the bound.
    """
    last = _of_last_stage(
        records,
        lambda generation, i: (
            *(generation, i["id"], sys.intern(i["tree"]), i["fitness"]),
            limited(i["counters"], constraints),
        ),
    )
    first, end = last[0][0], last[-1][0] + 1
    parts = min(most, max(1, (end - first) // PART))
    evaluations_by_part: list[dict[str, _Evaluations]] = [{} for _ in range(parts)]
    for generation, name, tree, fitness, counters in last:
        part = evaluations_by_part[(generation - first) * parts // (end - first)]
        evaluations = part.setdefault(tree, _Evaluations())
        evaluations.generation, evaluations.id = generation, name
        evaluations.fitness[generation] = fitness
        evaluations.count += 1
        evaluations.counters = running_mean(
            evaluations.counters or counters, counters, evaluations.count
        )
    best = {
        c.tree: c
        for part in evaluations_by_part
        for c in _by_bound(part, bound_width, constraints, shrinkage)[: most // parts]
    }
    return sorted(best.values(), key=lambda c: c.merit, reverse=True)


def _by_bound(
    evaluations: Mapping[str, _Evaluations],
    bound_width: float,
    constraints: Constraints,
    shrinkage: float,
) -> list[Candidate]:
    """All trees as candidates, those with the highest lower bounds first."""
    fitness = [evaluation.fitness for evaluation in evaluations.values()]
    levels, sd = estimate(fitness, shrinkage)
    everyone = [
        Candidate(
            evaluation.generation,
            evaluation.id,
            tree,
            level - bound_width * sd / sqrt(len(evaluation.fitness)),
            violation(evaluation.counters, constraints),
        )
        for (tree, evaluation), level in zip(evaluations.items(), levels, strict=True)
    ]
    return sorted(everyone, key=lambda c: c.merit, reverse=True)


@dataclass(slots=True)
class _Evaluations:
    """The evaluations of a tree in the records."""

    generation: int = 0  # its last
    id: str = ""  # of its last individual
    fitness: dict[int, float] = field(default_factory=dict)  # points by generation
    counters: dict[str, float] = field(default_factory=dict)  # with limits, means
    count: int = 0  # of evaluations


def _ordered(last: Sequence[_Shown], classes: Classes, top: int) -> Iterator[Candidate]:
    """Individuals in the order in which they become candidates."""
    by_merit = sorted(last, key=lambda pair: pair[0].merit, reverse=True)
    by_generation: dict[int, list[Candidate]] = {}
    for candidate, _ in by_merit:
        by_generation.setdefault(candidate.generation, []).append(candidate)
    newest = [by_generation[generation] for generation in sorted(by_generation, reverse=True)]
    for rank in range(top):
        for ranked in newest:
            yield from ranked[rank : rank + 1]
        if rank == 0:
            for name in (*classes.tiers, *classes.specialist_names, *classes.behaviours):
                yield from [candidate for candidate, behaviours in by_merit if name in behaviours][
                    :1
                ]


def validation_seeds(
    seed: int, used: frozenset[int], n: int, purpose: Stream = Stream.VALIDATION
) -> tuple[int, ...]:
    """The first `n` worlds of a run for a purpose, by default validation, that are not used."""
    draws = (int(stream(seed, purpose, slot=i).integers(2**32)) for i in range(n + len(used)))
    return tuple(world for world in draws if world not in used)[:n]


def entrants(trees: Sequence[Candidate], episodes: int) -> Sequence[Candidate]:
    """The candidates of the first round: all, or the best in training if episodes are few.

    Args:
        candidates: at least one.
        episodes: of all candidates together, >= 1.

    Returns:
        At least one candidate.
    """
    if sum(size * new for size, new in rounds(len(trees), episodes)) <= episodes:
        return trees
    ranked = sorted(trees, key=lambda c: c.merit, reverse=True)
    return ranked[: max(1, episodes // WORLDS_EACH)]


def rounds(n: int, episodes: int) -> list[tuple[int, int]]:
    """The numbers of candidates and of new worlds of each round, for about `episodes` episodes."""
    sizes = [n]
    while sizes[-1] > FINALISTS:
        sizes.append(max(FINALISTS, (sizes[-1] + 1) // 2))
    each = episodes // len(sizes)
    return [(size, max(1, each // size)) for size in sizes]


def validate(
    candidates: Sequence[Candidate],
    worlds: Sequence[int],
    evaluator: Evaluator,
    stage: int,
    classes: Classes,
    *,
    episodes: int,
    reference_tree: tuple[str, str] | None = None,
    constraints: Constraints = NO_CONSTRAINTS,
) -> list[tuple[Candidate, Validation]]:
    """Evaluates candidates by successive halving.

    Args:
        candidates: at least one.
        worlds: validation worlds, enough for all rounds; the same for all candidates.
        evaluator: runs the episodes.
        stage: index of the curriculum's stage that scores them.
        classes: with the tiers to count.
        episodes: approximate number of episodes.
        reference_tree: name and canonical text of a tree to compare the winner with.
        constraints: take precedence over fitness, by the counters' means over the worlds.

    Returns:
        The candidates of the last round with their results, the best first.

    Raises:
        EvaluationError: an episode failed.
    """
    results = {candidate: list[Outcome]() for candidate in candidates}
    count = 0  # worlds so far

    def worth(c: Candidate) -> Merit:
        """By the outcomes so far; before the first round, by training."""
        if not results[c]:
            return c.merit
        return merit(fmean(o.fitness for o in results[c]), mean_violation(results[c], constraints))

    for size, new in rounds(len(candidates), episodes):
        ranked = sorted(results, key=worth, reverse=True)[:size]
        batch = worlds[count : count + new]
        outcomes = evaluator.evaluate([Job(c.tree, stage, w) for c in ranked for w in batch])
        results = {
            c: [*results[c], *outcomes[k * len(batch) : (k + 1) * len(batch)]]
            for k, c in enumerate(ranked)
        }
        count += len(batch)
    order = sorted(results, key=worth, reverse=True)
    judged = [(c, _validation(worlds[:count], results[c], classes, constraints)) for c in order]
    if reference_tree is not None:
        name, text = reference_tree
        references = evaluator.evaluate([Job(text, stage, world) for world in worlds[:count]])
        best, verdict = judged[0]
        judged[0] = (best, compared(verdict, results[best], references, name))
    return judged


def _validation(
    worlds: Sequence[int], outcomes: Sequence[Outcome], classes: Classes, constraints: Constraints
) -> Validation:
    mean, low, high = interval([o.fitness for o in outcomes])
    reached = [tiers(o, classes) for o in outcomes]
    shares = {name: fmean(name in own for own in reached) for name in classes.tiers}
    verdict = Validation(tuple(worlds), mean, low, high, shares)
    if not constraints:
        return verdict
    share = feasible_share([o.counters for o in outcomes], constraints)
    return replace(verdict, violation=mean_violation(outcomes, constraints), feasible=share)


def compared(
    verdict: Validation, outcomes: Sequence[Outcome], references: Sequence[Outcome], name: str
) -> Validation:
    """The results, with the paired differences to a reference tree in the same worlds."""
    pairs = [a.fitness - b.fitness for a, b in zip(outcomes, references, strict=True)]
    mean, low, high = interval(pairs)
    return replace(
        verdict, yardstick=name, difference=mean, difference_low=low, difference_high=high
    )
