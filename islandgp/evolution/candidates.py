"""The candidates for a run's best robot: the most promising trees of its last stage."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, zip_longest
from math import sqrt
from typing import Any, Final, TypeVar

from islandgp.gp.evidence import SHRINKAGE, estimate
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import (
    NO_CONSTRAINTS,
    Constraints,
    Merit,
    limited,
    merit,
    running_mean,
    violation,
)

MAX_CANDIDATES: Final = 24
TOP_PER_GENERATION: Final = 2  # candidates per generation
PART: Final = 100  # least generations of a part of a long run

T = TypeVar("T")


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


def last_stage(
    records: Iterable[Mapping[str, Any]],
    constraints: Constraints,
    keep: Callable[[Mapping[str, Any]], T],
) -> list[tuple[Candidate, T]]:
    """The individuals of the last stage, each with what `keep` returns for its record.

    Nothing else is kept, as long runs have tens of thousands of individuals.

    Args:
        records: of all generations as plain values, oldest first.
        constraints: of the run.
        keep: called with the record of an individual.
    """
    stage, kept = None, list[tuple[Candidate, T]]()
    for record in records:
        now = record["snapshot"]
        if now["stage"] != stage:
            stage, kept = now["stage"], []
        for i in record["individuals"]:
            tree, excess = sys.intern(i["tree"]), violation(i["counters"], constraints)
            candidate = Candidate(now["generation"], i["id"], tree, i["fitness"], excess)
            kept.append((candidate, keep(i)))
    return kept


def by_fitness(
    records: Iterable[Mapping[str, Any]],
    classes: Classes,
    constraints: Constraints = NO_CONSTRAINTS,
) -> list[Candidate]:
    """The best individuals of each generation, and of each tier, class and behaviour.

    Trees are distinct. Individuals that keep the constraints come first, then the fittest.

    Args:
        records: as for `last_stage`.
        classes: with the tiers, classes and behaviours.
        constraints: of the run.
    """

    def names(i: Mapping[str, Any]) -> frozenset[str]:
        return frozenset((*i["tiers"], i["specialist"], *classes.behaviours_of(i["counters"])))

    shown = last_stage(records, constraints, names)
    shown.sort(key=lambda pair: pair[0].merit, reverse=True)
    by_generation: dict[int, list[Candidate]] = {}
    for c, _ in shown:
        by_generation.setdefault(c.generation, []).append(c)
    newest = [by_generation[generation] for generation in sorted(by_generation, reverse=True)]
    ranks = [*zip_longest(*newest)][:TOP_PER_GENERATION]
    named = [
        next((c for c, own in shown if name in own), None)
        for name in (*classes.tiers, *classes.specialist_names, *classes.behaviours)
    ]
    by_tree: dict[str, Candidate] = {}
    for candidate in (*chain(*ranks[:1]), *named, *chain(*ranks[1:])):
        if candidate is not None:
            by_tree.setdefault(candidate.tree, candidate)
    return list(by_tree.values())[:MAX_CANDIDATES]


def by_evidence(
    records: Iterable[Mapping[str, Any]],
    *,
    most: int = MAX_CANDIDATES,
    bound_width: float = 1.0,
    constraints: Constraints = NO_CONSTRAINTS,
    shrinkage: float = SHRINKAGE,
) -> list[Candidate]:
    """The trees with the highest lower bounds of their mean fitness.

    Trees that keep the constraints, by the means of their counters over all evaluations, come
    first. A stage of at least 2 * PART generations is divided into parts with equal numbers of
    candidates: trees of distant generations did not meet the same worlds, so their levels cannot
    be compared.

    Args:
        records: as for `last_stage`, with an individual.
        most: maximum number of candidates.
        bound_width: standard errors between a tree's level (`evidence.estimate`) and its bound.
        constraints: of the run.
        shrinkage: as in `evidence.estimate`.

    Returns:
        The candidates, best first; `trained` is the bound.
    """
    last = last_stage(records, constraints, lambda i: limited(i["counters"], constraints))
    first, end = last[0][0].generation, last[-1][0].generation + 1
    parts = min(most, max(1, (end - first) // PART))
    by_part: list[dict[str, list[tuple[Candidate, dict[str, float]]]]] = [{} for _ in range(parts)]
    for c, counters in last:
        part = by_part[(c.generation - first) * parts // (end - first)]
        part.setdefault(c.tree, []).append((c, counters))
    best: dict[str, Candidate] = {}
    for part in by_part:
        points = [{c.generation: c.trained for c, _ in own} for own in part.values()]
        levels, sd = estimate(points, shrinkage)
        bounds = [
            replace(
                own[-1][0],
                trained=level - bound_width * sd / sqrt(len(fitness)),
                violation=violation(_means([each for _, each in own]), constraints),
            )
            for own, fitness, level in zip(part.values(), points, levels, strict=True)
        ]
        best |= {c.tree: c for c in _sorted(bounds)[: most // parts]}
    return _sorted(best.values())


def _means(counters: Sequence[dict[str, float]]) -> dict[str, float]:
    """The means of the counters of several evaluations."""
    means = counters[0]
    for n, now in enumerate(counters[1:], 2):
        means = running_mean(means, now, n)
    return means


def _sorted(candidates: Iterable[Candidate]) -> list[Candidate]:
    return sorted(candidates, key=lambda c: c.merit, reverse=True)
