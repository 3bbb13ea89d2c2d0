"""The candidates for a run's best robot: the most promising trees of its last stage."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, Final

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


class Candidates(ABC):
    """Collects the individuals of a run's last stage, generation by generation.

    It keeps what the choice needs only, as long runs have tens of thousands of individuals.
    """

    def __init__(self, constraints: Constraints) -> None:
        self.constraints = constraints
        self._stage: int | None = None
        self._kept: list[Any] = []

    def add(self, record: Mapping[str, Any]) -> None:
        """Add a generation, given its record as plain values, oldest first."""
        now = record["snapshot"]
        if now["stage"] != self._stage:
            self._stage, self._kept = now["stage"], []
        self._kept += [self._keep(now["generation"], i) for i in record["individuals"]]

    def best_of(self, records: Iterable[Mapping[str, Any]]) -> list[Candidate]:
        """The candidates after adding these generations."""
        for record in records:
            self.add(record)
        return self.best()

    @abstractmethod
    def _keep(self, generation: int, i: Mapping[str, Any]) -> Any:
        """The values of an individual that `best` needs."""

    @abstractmethod
    def best(self) -> list[Candidate]:
        """The candidates among the individuals so far, of which there must be one."""


_Shown = tuple[Candidate, frozenset[str]]
"""A candidate with its class, tiers and behaviours."""


class CandidatesByFitness(Candidates):
    """The best individuals of each generation, and of each tier, class and behaviour.

    Trees are distinct. Individuals that keep the constraints come first, then the fittest.
    """

    def __init__(
        self,
        classes: Classes,
        *,
        most: int = MAX_CANDIDATES,
        top: int = TOP_PER_GENERATION,
        tier: str = "",
        constraints: Constraints = NO_CONSTRAINTS,
    ) -> None:
        """Collects nothing yet.

        Args:
            classes: with the tiers, classes and behaviours.
            most: maximum number of candidates.
            top: number of candidates per generation.
            tier: in training, of all candidates; "": any.
            constraints: of the run.
        """
        super().__init__(constraints)
        self.classes = classes
        self.most = most
        self.top = top
        self.tier = tier

    def _keep(self, generation: int, i: Mapping[str, Any]) -> _Shown:
        counters = i["counters"]
        behaviours = self.classes.behaviours_of(counters)
        tree = sys.intern(i["tree"])  # elites are copies
        excess = violation(counters, self.constraints)
        candidate = Candidate(generation, i["id"], tree, i["fitness"], excess)
        return candidate, frozenset((*i["tiers"], i["specialist"], *behaviours))

    def best(self) -> list[Candidate]:
        """See `Candidates`. Empty if no individual reached the tier."""
        shown: list[_Shown] = self._kept
        last = [pair for pair in shown if not self.tier or self.tier in pair[1]]
        by_tree: dict[str, Candidate] = {}
        for candidate in _ordered(last, self.classes, self.top):
            by_tree.setdefault(candidate.tree, candidate)
        return list(by_tree.values())[: self.most]


def _ordered(last: Sequence[_Shown], classes: Classes, top: int) -> Iterator[Candidate]:
    """Individuals in the order in which they become candidates."""
    by_merit = sorted(last, key=lambda pair: pair[0].merit, reverse=True)
    by_generation: dict[int, list[Candidate]] = {}
    for candidate, _ in by_merit:
        by_generation.setdefault(candidate.generation, []).append(candidate)
    newest = [by_generation[generation] for generation in sorted(by_generation, reverse=True)]
    most = max(map(len, newest), default=0)
    for rank in range(min(top, most)):
        for ranked in newest:
            yield from ranked[rank : rank + 1]
        if rank == 0:
            for name in (*classes.tiers, *classes.specialist_names, *classes.behaviours):
                yield from [candidate for candidate, behaviours in by_merit if name in behaviours][
                    :1
                ]


class CandidatesByEvidence(Candidates):
    """The trees with the highest lower bounds of their mean fitness.

    Trees that keep the constraints, by the means of their counters over all evaluations, come
    first. A stage of at least 2 * PART generations is divided into parts with equal numbers of
    candidates: trees of distant generations did not meet the same worlds, so their levels cannot
    be compared.
    """

    def __init__(
        self,
        *,
        most: int = MAX_CANDIDATES,
        bound_width: float = 1.0,
        constraints: Constraints = NO_CONSTRAINTS,
        shrinkage: float = SHRINKAGE,
    ) -> None:
        """Collects nothing yet.

        Args:
            most: maximum number of candidates.
            bound_width: standard errors between a tree's level (`evidence.estimate`) and its
                bound.
            constraints: of the run.
            shrinkage: as in `evidence.estimate`.
        """
        super().__init__(constraints)
        self.most = most
        self.bound_width = bound_width
        self.shrinkage = shrinkage

    def _keep(self, generation: int, i: Mapping[str, Any]) -> _Evaluation:
        counters = limited(i["counters"], self.constraints)
        return generation, i["id"], sys.intern(i["tree"]), i["fitness"], counters

    def best(self) -> list[Candidate]:
        """See `Candidates`. Best first; `trained` is the bound."""
        last: list[_Evaluation] = self._kept
        first, end = last[0][0], last[-1][0] + 1
        parts = min(self.most, max(1, (end - first) // PART))
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
            for c in self._by_bound(part)[: self.most // parts]
        }
        return sorted(best.values(), key=lambda c: c.merit, reverse=True)

    def _by_bound(self, evaluations: Mapping[str, _Evaluations]) -> list[Candidate]:
        """All trees as candidates, those with the highest lower bounds first."""
        fitness = [evaluation.fitness for evaluation in evaluations.values()]
        levels, sd = estimate(fitness, self.shrinkage)
        everyone = [
            Candidate(
                evaluation.generation,
                evaluation.id,
                tree,
                level - self.bound_width * sd / sqrt(len(evaluation.fitness)),
                violation(evaluation.counters, self.constraints),
            )
            for (tree, evaluation), level in zip(evaluations.items(), levels, strict=True)
        ]
        return sorted(everyone, key=lambda c: c.merit, reverse=True)


_Evaluation = tuple[int, str, str, float, dict[str, float]]
"""Generation, id, canonical text, points, and counters with limits of an individual."""


@dataclass(slots=True)
class _Evaluations:
    """The evaluations of a tree in the records."""

    generation: int = 0  # its last
    id: str = ""  # of its last individual
    fitness: dict[int, float] = field(default_factory=dict)  # points by generation
    counters: dict[str, float] = field(default_factory=dict)  # with limits, means
    count: int = 0  # of evaluations
