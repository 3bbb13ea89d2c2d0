"""MAP-Elites: the best tree of each cell of a grid over counters.

Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909. A tree
competes only with trees of its cell. The cell and the fitness of a tree are means over all its
episodes. Each generation evaluates some elites again, those with the fewest episodes first. A cell
keeps several trees, so that another one can replace an elite whose mean falls. Re-evaluation in
noisy tasks: Justesen, Risi and Mouret 2019, "MAP-Elites for noisy domains by adaptive sampling"
(GECCO).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pydantic import BaseModel, Field

from islandgp.domain import Schema
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated
from islandgp.scoring.constraints import NO_COUNTERS, Merit, limited, merit, running_mean, violation
from islandgp.search.base import SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    BreedingSettings,
    GenerationPlan,
    Parent,
    digest,
    parent_of,
)
from islandgp.search.descriptor import Descriptor, cell, dimensions, faults, point


class MapElitesSettings(BreedingSettings, frozen=True):
    """The grid."""

    descriptor: Descriptor
    """The grid's axes: COUNTER, or COUNTER/WIDTH for bins of equal width. Empty: the counters of
    the behaviours."""
    bins: int = Field(ge=1, le=100)  # most bins of a counter above 0
    depth: int = Field(ge=1, le=100)
    """Most trees that a cell keeps: the elite, and trees that can replace it."""

    def faults(self, schema: Schema) -> Iterator[str]:
        """See `Search`."""
        return faults("search.policy.descriptor", self.descriptor, schema)


@dataclass(frozen=True, slots=True)
class Occupant:
    """A tree in the grid, with means over its evaluations (one per generation)."""

    parent: Parent  # the tree, with the id of its last individual
    evaluations: int  # >= 1
    fitness: float  # mean, points
    descriptor: tuple[float, ...]  # mean value on each axis of the grid
    counters: dict[str, float] = field(default_factory=dict)  # means of those with a constraint


@dataclass(frozen=True, slots=True)
class Grid:
    """All trees of the grid, cell by cell, the best of a cell first."""

    occupants: tuple[Occupant, ...]


class MapElitesSlots(BaseModel, frozen=True, extra="forbid"):
    """The slots of a generation."""

    reevaluated: float = Field(ge=0, lt=1)  # share in which elites are evaluated again


class MapElites(BreedingSearch[MapElitesSettings]):
    """Keeps the best trees of each cell; see the module."""

    Settings = MapElitesSettings
    Allocation = MapElitesSlots
    Memory: ClassVar[Any] = Grid

    def __init__(self, settings: MapElitesSettings, plan: Plan) -> None:
        super().__init__(settings, plan)
        self.dimensions = dimensions(settings.descriptor, plan.classes)

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`."""
        occupants: tuple[Occupant, ...] = state.memory.occupants
        by_cell: dict[tuple[int, ...], Occupant] = {}
        for occupant in occupants:  # the best of a cell first
            by_cell.setdefault(cell(occupant.descriptor, self.settings.bins), occupant)
        elites = list(by_cell.values())
        parents = [elite.parent for elite in elites]
        mothers = [elite.parent for elite in elites if not self._violation(elite)] or parents
        slots = round(self.plan.allocation.reevaluated * self.plan.gp.population)
        least_evaluated = sorted(
            elites, key=lambda o: (-o.evaluations, self._merit(o)), reverse=True
        )
        return GenerationPlan(
            pick=lambda rng: (mothers[rng.integers(len(mothers))], parents),
            reevaluated=[elite.parent for elite in least_evaluated[:slots]],
            known_digests=(digest(o.parent.tree) for o in occupants),
        )

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Grid:
        """See `BreedingSearch`."""
        occupants = () if state.memory is None else state.memory.occupants
        by_digest = {digest(o.parent.tree): o for o in occupants}
        for e in evaluated:
            key = digest(e.individual.tree)
            descriptor = point(self.dimensions, e.outcome)
            counters = limited(e.outcome.counters, self.plan.constraints)
            by_digest[key] = updated(by_digest.get(key), e, descriptor, counters)
        cells = self.cells(tuple(by_digest.values())).values()
        return Grid(tuple(o for cell in cells for o in cell[: self.settings.depth]))

    def cells(self, occupants: Sequence[Occupant]) -> dict[tuple[int, ...], list[Occupant]]:
        """The occupants of each cell, the best first."""
        by_cell: dict[tuple[int, ...], list[Occupant]] = {}
        for occupant in sorted(occupants, key=self._merit, reverse=True):
            by_cell.setdefault(cell(occupant.descriptor, self.settings.bins), []).append(occupant)
        return by_cell

    def _merit(self, occupant: Occupant) -> Merit:
        return merit(occupant.fitness, self._violation(occupant))

    def _violation(self, occupant: Occupant) -> float:
        return violation(occupant.counters, self.plan.constraints)


def updated(
    before: Occupant | None,
    e: Evaluated,
    descriptor: Sequence[float],
    counters: Mapping[str, float] = NO_COUNTERS,
) -> Occupant:
    """The occupant of a tree after one more evaluation.

    Args:
        before: the occupant so far; None at its first evaluation.
        e: the evaluation.
        descriptor: of this evaluation, a value per axis of the grid.
        counters: of this evaluation, those with a constraint.
    """
    parent = parent_of(e)
    if before is None:
        return Occupant(parent, 1, e.fitness, tuple(descriptor), dict(counters))
    n = before.evaluations + 1
    means = (old + (new - old) / n for old, new in zip(before.descriptor, descriptor, strict=True))
    fitness = before.fitness + (e.fitness - before.fitness) / n
    return Occupant(parent, n, fitness, tuple(means), running_mean(before.counters, counters, n))
