"""Selects a run's best robot by successive halving on held-out seeds.

The highest fitness of a generation depends partly on its worlds, and stages have different scales.
So the most promising trees of the last stage are evaluated again in the same validation worlds, by
successive halving (Jamieson and Talwalkar 2016): each round drops half of the candidates and
evaluates the others in more worlds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, islice
from statistics import fmean
from types import MappingProxyType
from typing import Final

from islandgp.domain import Outcome
from islandgp.evaluation.base import Evaluator, evaluated
from islandgp.evolution.candidates import Candidate
from islandgp.gp.record import IndividualRecord
from islandgp.gp.selection import halved
from islandgp.plain import NanAsNull
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import (
    NO_CONSTRAINTS,
    Constraints,
    Merit,
    feasible_share,
    mean_violation,
    merit,
)
from islandgp.scoring.explain import NodeUsage
from islandgp.seeding import Stream, seed_of
from islandgp.statistics import mean_interval

FINALISTS: Final = 3  # candidates of the last round
NO_OTHERS: Final[Mapping[str, Sequence[Outcome]]] = MappingProxyType({})
WORLDS_EACH: Final = 5  # per candidate, if there are too few episodes for all candidates


@dataclass(frozen=True, slots=True)
class TreeComparison:
    """The paired differences of a tree to another one in the same worlds."""

    name: str  # of the other tree
    mean: float  # points
    low: NanAsNull  # 95 % interval of the mean, Student's t
    high: NanAsNull


@dataclass(frozen=True, slots=True)
class Validation:
    """Results of a tree in worlds."""

    worlds: tuple[int, ...]  # world seeds
    mean: float  # points, mean over the worlds
    low: NanAsNull  # 95 % interval of the mean, Student's t
    high: NanAsNull
    reached: dict[str, float]  # share of the worlds by tier
    comparisons: tuple[TreeComparison, ...] = ()  # with other trees
    violation: float | None = None  # of the constraints, by the counters' means; None: none
    feasible: float | None = None  # share of the worlds in which all are kept; None: none


@dataclass(frozen=True, slots=True)
class FrontTree:
    """A tree of a front of size against points."""

    nodes: int
    tree: str  # canonical text
    difference: TreeComparison | None  # to the longest tree in fresh worlds; None for the longest
    chosen: bool = False  # True: the best robot


@dataclass(frozen=True, slots=True)
class Best:
    """A run's best robot."""

    generation: int
    record: IndividualRecord  # of the individual, with the tree before it was shortened
    tree: str  # canonical text, shortened
    text: str  # the tree with comments on its branches
    validation: Validation | None  # of the tree in worlds that chose nothing; None: not validated
    front: tuple[FrontTree, ...] = ()  # the shortest first; (): it was not shortened
    changes: tuple[str, ...] = ()  # from the individual's tree to the shortest one
    chosen_in: tuple[int, ...] = ()  # worlds in which it was chosen and shortened
    usage: tuple[NodeUsage, ...] = ()  # by node of the tree; (): it was not explained


def validation_seeds(
    seed: int, used: frozenset[int], n: int, purpose: Stream = Stream.VALIDATION
) -> tuple[int, ...]:
    """The first `n` worlds of a run for a purpose, by default validation, that are not used."""
    return tuple(fresh_worlds(seed, used, purpose)(n))


def fresh_worlds(
    seed: int, used: frozenset[int] = frozenset(), purpose: Stream = Stream.PRUNING
) -> Callable[[int], list[int]]:
    """A function that returns that number of new worlds at each call.

    Args:
        seed: of the run.
        used: worlds that are left out.
        purpose: of the worlds, by default to shorten a tree.
    """
    draws = (seed_of(seed, purpose, slot=slot) for slot in count())
    new = (world for world in draws if world not in used)
    return lambda n: list(islice(new, n))


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
        sizes.append(halved(sizes[-1], FINALISTS))
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
        constraints: take precedence over fitness, by the counters' means over the worlds.

    Returns:
        The candidates of the last round with their results, the best first.

    Raises:
        EvaluationError: an episode failed.
    """
    results = {candidate: list[Outcome]() for candidate in candidates}
    tried = 0  # worlds so far

    def rank_key(c: Candidate) -> Merit:
        """By the outcomes so far; before the first round, by training."""
        if not results[c]:
            return c.merit
        return merit(fmean(o.fitness for o in results[c]), mean_violation(results[c], constraints))

    for size, new in rounds(len(candidates), episodes):
        ranked = sorted(results, key=rank_key, reverse=True)[:size]
        batch = worlds[tried : tried + new]
        outcomes = evaluated(evaluator, [c.tree for c in ranked], stage, batch)
        results = {c: results[c] + new for c, new in zip(ranked, outcomes, strict=True)}
        tried += len(batch)
    order = sorted(results, key=rank_key, reverse=True)
    return [(c, judged(worlds[:tried], results[c], classes, constraints)) for c in order]


def judged(
    worlds: Sequence[int],
    outcomes: Sequence[Outcome],
    classes: Classes,
    constraints: Constraints,
    others: Mapping[str, Sequence[Outcome]] = NO_OTHERS,
) -> Validation:
    """The results of a tree from its outcomes.

    Args:
        worlds: at least one seed.
        outcomes: one for each world.
        classes: with the tiers to count.
        constraints: to check.
        others: outcomes of other trees in the same worlds, by name.
    """
    mean, low, high = mean_interval([o.fitness for o in outcomes])
    reached = [tiers(o, classes) for o in outcomes]
    shares = {name: fmean(name in own for own in reached) for name in classes.tiers}
    comparisons = tuple(compared(name, outcomes, other) for name, other in others.items())
    verdict = Validation(tuple(worlds), mean, low, high, shares, comparisons)
    if not constraints:
        return verdict
    share = feasible_share([o.counters for o in outcomes], constraints)
    return replace(verdict, violation=mean_violation(outcomes, constraints), feasible=share)


def compared(name: str, outcomes: Sequence[Outcome], others: Sequence[Outcome]) -> TreeComparison:
    """The paired differences of outcomes to those of the tree of that name."""
    pairs = [a.fitness - b.fitness for a, b in zip(outcomes, others, strict=True)]
    return TreeComparison(name, *mean_interval(pairs))
