"""Selects a run's best robot by successive halving on held-out seeds.

The highest fitness of a generation depends partly on its worlds, and stages have different scales.
So the most promising trees of the last stage are evaluated again in the same validation worlds, by
successive halving (Jamieson and Talwalkar 2016): each round drops half of the candidates and
evaluates the others in more worlds.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from statistics import fmean
from typing import Any, Final

from islandgp.domain import Outcome
from islandgp.evaluation.base import Evaluator, Job
from islandgp.gp.evidence import estimate
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

MOST: Final = 24  # candidates
FINALISTS: Final = 3  # candidates of the last round
WORLDS_EACH: Final = 5  # per candidate, if there are too few episodes for all candidates
TOP: Final = 2  # candidates per generation


@dataclass(frozen=True, slots=True)
class Candidate:
    """An individual that may be the best robot."""

    generation: int
    id: str  # of the individual
    tree: str  # canonical text
    trained: float  # points, its fitness in its own generation
    violation: float = 0.0  # of the constraints in training, >= 0

    @property
    def merit(self) -> Merit:
        """Sort key of candidates before the first round: feasible before fit."""
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
    feasible: float | None = None  # share of the worlds in which all are kept; None: as above


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
    most: int = MOST,
    top: int = TOP,
    tier: str = "",
    constraints: Constraints = NO_CONSTRAINTS,
) -> list[Candidate]:
    """The most promising distinct trees of the last stage.

    These are the best of each generation and of each tier, class and behaviour: the fittest, with
    constraints feasible before fit.

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
    stage: int | None = None
    last: list[tuple[int, Mapping[str, Any]]] = []
    for record in records:
        if record["snapshot"]["stage"] != stage:  # earlier stages are ignored
            stage, last = record["snapshot"]["stage"], []
        last += [
            (record["snapshot"]["generation"], _slim(i, classes, constraints))
            for i in record["individuals"]
            if not tier or tier in i["tiers"]
        ]
    by_tree: dict[str, Candidate] = {}
    for generation, i in _ordered(last, classes, top):
        if i["tree"] not in by_tree and len(by_tree) < most:
            broken, points = i["violation"], i["fitness"]
            by_tree[i["tree"]] = Candidate(generation, i["id"], i["tree"], points, broken)
    return list(by_tree.values())


def candidates_by_evidence(
    records: Iterable[Mapping[str, Any]],
    *,
    most: int = MOST,
    caution: float = 1.0,
    constraints: Constraints = NO_CONSTRAINTS,
) -> list[Candidate]:
    """The trees of the last stage with the highest lower bounds of their mean fitness.

    Constraints come first, by the means of the counters over all evaluations of a tree.

    Args:
        records: generation records as plain values, oldest first; they are read once.
        most: candidates.
        caution: standard errors between a tree's level (`evidence.estimate`) and its bound.
        constraints: of the run.

    Returns:
        Candidates, best first; `trained` is the bound.
    """
    stage: int | None = None
    evaluations: dict[str, _Evaluations] = {}
    for record in records:
        generation = record["snapshot"]["generation"]
        if record["snapshot"]["stage"] != stage:
            stage, evaluations = record["snapshot"]["stage"], {}
        for i in record["individuals"]:
            tree = sys.intern(i["tree"])
            seen = evaluations.setdefault(tree, _Evaluations())
            seen.generation, seen.id = generation, i["id"]
            seen.fitness[generation] = i["fitness"]
            now = limited(i["counters"], constraints)
            seen.counters = running_mean(seen.counters or now, now, seen.evaluations + 1)
            seen.evaluations += 1
    levels, sd = estimate([seen.fitness for seen in evaluations.values()])
    everyone = [
        Candidate(
            seen.generation,
            seen.id,
            tree,
            level - caution * sd / sqrt(len(seen.fitness)),
            violation(seen.counters, constraints),
        )
        for (tree, seen), level in zip(evaluations.items(), levels, strict=True)
    ]
    return sorted(everyone, key=lambda c: c.merit, reverse=True)[:most]


@dataclass(slots=True)
class _Evaluations:
    """The evaluations of a tree in the records."""

    generation: int = 0  # its last
    id: str = ""  # of its last individual
    fitness: dict[int, float] = field(default_factory=dict)  # points by generation
    counters: dict[str, float] = field(default_factory=dict)  # with limits, means
    evaluations: int = 0


def _slim(
    individual: Mapping[str, Any], classes: Classes, constraints: Constraints
) -> dict[str, Any]:
    """The values of an individual that are needed here; long runs have tens of thousands."""
    return {
        "id": individual["id"],
        "tree": sys.intern(individual["tree"]),  # elites are copies
        "fitness": individual["fitness"],
        "shown": frozenset(_shown(individual, classes)),
        "violation": violation(individual["counters"], constraints),
    }


def _ordered(
    last: Sequence[tuple[int, Mapping[str, Any]]], classes: Classes, top: int
) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Individuals in the order in which they become candidates."""

    def worth(pair: tuple[int, Mapping[str, Any]]) -> Merit:
        return merit(pair[1]["fitness"], pair[1]["violation"])

    by_fitness = sorted(last, key=worth, reverse=True)
    own: dict[int, list[tuple[int, Mapping[str, Any]]]] = {}
    for pair in by_fitness:
        own.setdefault(pair[0], []).append(pair)
    newest = [own[generation] for generation in sorted(own, reverse=True)]
    for rank in range(top):
        for ranked in newest:
            yield from ranked[rank : rank + 1]
        if rank == 0:
            for name in (*classes.tiers, *classes.specialist_names, *classes.behaviours):
                yield from [pair for pair in by_fitness if name in pair[1]["shown"]][:1]


def _shown(individual: Mapping[str, Any], classes: Classes) -> set[str]:
    """The tiers, the class and the behaviours of an individual."""
    counters = individual["counters"]
    does = {name for name, counter in classes.behaviours.items() if counters[counter] > 0}
    return {*individual["tiers"], individual["specialist"], *does}


def validation_seeds(
    seed: int, used: frozenset[int], n: int, purpose: Stream = Stream.VALIDATION
) -> tuple[int, ...]:
    """The first `n` worlds of a run for a purpose, by default validation, that are not used."""
    drawn = (int(stream(seed, purpose, slot=i).integers(2**32)) for i in range(n + len(used)))
    return tuple(world for world in drawn if world not in used)[:n]


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
    """(candidates, new worlds) of each round, for `n` candidates and about `episodes` episodes."""
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
    met = 0

    def worth(c: Candidate) -> Merit:
        """By the outcomes so far; before the first round, by training."""
        if not results[c]:
            return c.merit
        return merit(fmean(o.fitness for o in results[c]), mean_violation(results[c], constraints))

    for size, new in rounds(len(candidates), episodes):
        ranked = sorted(results, key=worth, reverse=True)[:size]
        batch = worlds[met : met + new]
        outcomes = evaluator.evaluate([Job(c.tree, stage, w) for c in ranked for w in batch])
        results = {
            c: [*results[c], *outcomes[k * len(batch) : (k + 1) * len(batch)]]
            for k, c in enumerate(ranked)
        }
        met += len(batch)
    order = sorted(results, key=worth, reverse=True)
    judged = [(c, _judged(worlds[:met], results[c], classes, constraints)) for c in order]
    if reference_tree is not None:
        name, text = reference_tree
        theirs = evaluator.evaluate([Job(text, stage, world) for world in worlds[:met]])
        best, verdict = judged[0]
        judged[0] = (best, compared(verdict, results[best], theirs, name))
    return judged


def _judged(
    worlds: Sequence[int],
    outcomes: Sequence[Outcome],
    classes: Classes,
    constraints: Constraints,
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
    verdict: Validation, own: Sequence[Outcome], theirs: Sequence[Outcome], name: str
) -> Validation:
    """The results with the paired differences to a reference tree in the same worlds."""
    pairs = [a.fitness - b.fitness for a, b in zip(own, theirs, strict=True)]
    mean, low, high = interval(pairs)
    return replace(
        verdict, yardstick=name, difference=mean, difference_low=low, difference_high=high
    )
