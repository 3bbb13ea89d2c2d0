"""MAP-Elites: the best tree of each kind of behaviour.

Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909. A tree
competes only with the trees in its cell of a grid over counters. The value of an elite is the mean
of all its episodes. In each generation some elites are evaluated again, those with the fewest
episodes first. A cell keeps several trees, so that another can replace an elite whose mean falls.
For re-evaluation in noisy tasks see Justesen, Risi and Mouret 2019, "MAP-Elites for noisy domains
by adaptive sampling" (GECCO).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pydantic import Field

from islandgp.domain import Schema
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated
from islandgp.scoring.constraints import (
    NO_COUNTERS,
    Merit,
    limited,
    merit,
    running_mean,
    violation,
)
from islandgp.search.base import SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    BreedingSettings,
    Brood,
    Parent,
    digest,
    parent_of,
)
from islandgp.search.descriptor import Descriptor, cell, dimensions, faults, point


class MapElitesSettings(BreedingSettings, frozen=True):
    """The grid, and how elites are evaluated again."""

    descriptor: Descriptor
    """Counters, or COUNTER/WIDTH for bins of equal width; none: the behaviours' counters."""
    bins: int = Field(ge=1, le=100)  # most bins of a counter above 0
    depth: int = Field(ge=1, le=100)
    """Most trees that a cell keeps: the elite, and trees that can replace it."""
    again: float = Field(ge=0, lt=1)
    """Share of a generation's slots in which elites are evaluated once more."""

    def faults(self, schema: Schema) -> Iterator[str]:
        """See `Search`."""
        return faults("search.policy.descriptor", self.descriptor, schema)


@dataclass(frozen=True, slots=True)
class Occupant:
    """A tree in the grid."""

    parent: Parent  # with the id of its last individual
    n: int  # generations in whose worlds it was evaluated
    fitness: float  # mean over these, points
    place: tuple[float, ...]  # mean over these, in the space of behaviours
    counters: dict[str, float] = field(default_factory=dict)  # with limits, mean over these


@dataclass(frozen=True, slots=True)
class Grid:
    """All trees that are kept, a cell after the other, the best of a cell first."""

    occupants: tuple[Occupant, ...]


class MapElites(BreedingSearch[MapElitesSettings]):
    """See the module."""

    Settings = MapElitesSettings
    Memory: ClassVar[Any] = Grid

    def __init__(self, settings: MapElitesSettings, plan: Plan) -> None:
        super().__init__(settings, plan)
        self.dimensions = dimensions(settings.descriptor, plan.classes)

    def brood(self, state: SearchState) -> Brood:
        """See `BreedingSearch`."""
        occupants: tuple[Occupant, ...] = state.memory.occupants
        best = [cell[0] for cell in self.cells(occupants).values()]
        parents = [o.parent for o in best]
        mothers = [o.parent for o in best if not self._violation(o)] or parents
        fewest_episodes_first = sorted(best, key=lambda o: (-o.n, self._merit(o)), reverse=True)
        slots = round(self.settings.again * self.plan.gp.population)
        return Brood(
            pick=lambda rng: (mothers[rng.integers(len(mothers))], parents),
            reevaluated=[o.parent for o in fewest_episodes_first[:slots]],
            tried={digest(o.parent.tree) for o in occupants},
        )

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Grid:
        """See `BreedingSearch`."""
        occupants = () if state.memory is None else state.memory.occupants
        by_digest = {digest(o.parent.tree): o for o in occupants}
        for e in evaluated:
            key = digest(e.individual.tree)
            place = point(self.dimensions, e.outcome)
            counters = limited(e.outcome.counters, self.plan.constraints)
            by_digest[key] = updated(by_digest.get(key), e, place, counters)
        cells = self.cells(tuple(by_digest.values())).values()
        return Grid(tuple(o for cell in cells for o in cell[: self.settings.depth]))

    def cells(self, occupants: Sequence[Occupant]) -> dict[tuple[int, ...], list[Occupant]]:
        """The occupants of each cell, the best first."""
        by_cell: dict[tuple[int, ...], list[Occupant]] = {}
        for o in sorted(occupants, key=self._merit, reverse=True):
            by_cell.setdefault(cell(o.place, self.settings.bins), []).append(o)
        return by_cell

    def _merit(self, o: Occupant) -> Merit:
        return merit(o.fitness, self._violation(o))

    def _violation(self, o: Occupant) -> float:
        return violation(o.counters, self.plan.constraints)


def updated(
    before: Occupant | None,
    e: Evaluated,
    place: Sequence[float],
    counters: Mapping[str, float] = NO_COUNTERS,
) -> Occupant:
    """The occupant with one more evaluation; `before` is None at its first.

    `counters` are those with limits.
    """
    parent = parent_of(e)
    if before is None:
        return Occupant(parent, 1, e.fitness, tuple(place), dict(counters))
    n = before.n + 1
    means = (old + (new - old) / n for old, new in zip(before.place, place, strict=True))
    fitness = before.fitness + (e.fitness - before.fitness) / n
    return Occupant(parent, n, fitness, tuple(means), running_mean(before.counters, counters, n))
