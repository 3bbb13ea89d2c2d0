"""MAP-Elites: the best tree of each cell of a grid over counters.

Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv 1504.04909. A tree
competes only with trees of its cell. The cell and the fitness of a tree are means over all its
episodes. Each generation evaluates some elites again, those with the fewest episodes first. A cell
keeps several trees, so that another one can replace an elite whose mean falls. Re-evaluation in
noisy tasks: Justesen, Risi and Mouret 2019, "MAP-Elites for noisy domains by adaptive sampling"
(GECCO).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Any, ClassVar, Final

from pydantic import Field

from islandgp.gp.evidence import Evidence
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated
from islandgp.scoring.constraints import Merit, limited, merit, violation
from islandgp.search.base import SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    GenerationPlan,
    Parent,
    Slots,
    evidence_by_digest,
)
from islandgp.search.descriptor import DescriptorSettings, cell, point

FITNESS: Final = " fitness"  # among the means of a tree, beside counters with a constraint


class MapElitesSettings(DescriptorSettings, frozen=True):
    """The grid; its axes are those of the descriptor."""

    bins: int = Field(ge=1, le=100)  # most bins of a counter above 0
    depth: int = Field(ge=1, le=100)
    """Most trees that a cell keeps: the elite, and trees that can replace it."""


@dataclass(frozen=True, slots=True)
class Grid:
    """All trees of the grid, cell by cell, the best of a cell first."""

    occupants: tuple[Evidence, ...]


class MapElites(BreedingSearch[MapElitesSettings]):
    """Keeps the best trees of each cell; see the module."""

    Settings = MapElitesSettings
    Allocation = Slots
    Memory: ClassVar[Any] = Grid

    def __init__(self, settings: MapElitesSettings, plan: Plan) -> None:
        super().__init__(settings, plan)
        self.counters = settings.counters(plan.classes)
        self.axes = [f" axis {k}" for k in range(len(self.counters))]  # among the means

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`."""
        occupants: tuple[Evidence, ...] = state.memory.occupants
        by_cell: dict[tuple[int, ...], Evidence] = {}
        for occupant in occupants:  # the best of a cell first
            by_cell.setdefault(self._cell(occupant), occupant)
        elites = list(by_cell.values())
        parents = [Parent(elite.id, elite.tree) for elite in elites]
        able = [not self._merit(elite)[0] for elite in elites]
        mothers = list(compress(parents, able)) or parents
        slots = round(self.plan.allocation.reevaluated * self.plan.gp.population)
        least_evaluated = sorted(
            range(len(elites)),
            key=lambda k: (-len(elites[k].fitness), self._merit(elites[k])),
            reverse=True,
        )
        return GenerationPlan(
            pick=lambda rng: (mothers[rng.integers(len(mothers))], parents),
            reevaluated=[parents[k] for k in least_evaluated[:slots]],
            known_digests=(o.digest for o in occupants),
        )

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Grid:
        """See `BreedingSearch`."""
        occupants = () if state.memory is None else state.memory.occupants
        known = evidence_by_digest(occupants, evaluated, state.generation, self._values)
        cells = self.cells(tuple(known.values())).values()
        return Grid(tuple(o for cell in cells for o in cell[: self.settings.depth]))

    def _values(self, e: Evaluated) -> dict[str, float]:
        """The values of an evaluation whose means decide."""
        place = zip(self.axes, point(self.counters, e.outcome), strict=True)
        limits = limited(e.outcome.counters, self.plan.constraints)
        return {FITNESS: e.fitness, **dict(place), **limits}

    def cells(self, occupants: Sequence[Evidence]) -> dict[tuple[int, ...], list[Evidence]]:
        """The occupants of each cell, the best first."""
        by_cell: dict[tuple[int, ...], list[Evidence]] = {}
        for occupant in sorted(occupants, key=self._merit, reverse=True):
            by_cell.setdefault(self._cell(occupant), []).append(occupant)
        return by_cell

    def _cell(self, occupant: Evidence) -> tuple[int, ...]:
        return cell(tuple(occupant.means[axis] for axis in self.axes), self.settings.bins)

    def _merit(self, occupant: Evidence) -> Merit:
        means = occupant.means
        return merit(means[FITNESS], violation(means, self.plan.constraints))
