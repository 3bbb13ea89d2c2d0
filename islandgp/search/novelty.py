"""Novelty search: parents are selected by the novelty of their behaviour, not by fitness.

Lehman and Stanley 2011, "Abandoning Objectives: Evolution Through the Search for Novelty Alone",
Evolutionary Computation 19(2). An individual's novelty is its mean distance to the k nearest
neighbours in its generation and in an archive of earlier novel descriptors. The fittest individuals
of a generation are evaluated again in the next one, so good trees are not lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated
from islandgp.search.base import SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    GenerationPlan,
    Parent,
    Slots,
    parent_of,
    pick_by_rank,
)
from islandgp.search.descriptor import DescriptorSettings, point

Places = tuple[tuple[float, ...], ...]


class NoveltySettings(DescriptorSettings, frozen=True):
    """Settings of the novelty and of the selection of parents."""

    neighbours: int = Field(ge=1)  # number of neighbours in the mean distance
    archive: int = Field(ge=0)  # most descriptors in the archive; the oldest are dropped first
    added: int = Field(ge=0)  # most novel individuals of a generation that are added to it
    tournament: int = Field(ge=1)  # tournament size; the most novel individual wins


@dataclass(frozen=True, slots=True)
class Explored:
    """The last generation: smaller constraint violations first, then by novelty."""

    parents: tuple[Parent, ...]
    fittest: tuple[Parent, ...]  # best first
    archive: Places  # descriptors that were novel, oldest first


class Novelty(BreedingSearch[NoveltySettings]):
    """Novelty search; see the module."""

    Settings = NoveltySettings
    Allocation = Slots
    Memory: ClassVar[Any] = Explored

    def __init__(self, settings: NoveltySettings, plan: Plan) -> None:
        super().__init__(settings, plan)
        self.counters = settings.counters(plan.classes)

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`."""
        memory: Explored = state.memory
        return GenerationPlan(
            pick_by_rank(memory.parents, self.settings.tournament), reevaluated=memory.fittest
        )

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Explored:
        """See `BreedingSearch`."""
        archive: Places = () if state.memory is None else state.memory.archive
        places = tuple(point(self.counters, e.outcome) for e in evaluated)
        new = novelty(places, archive, self.settings.neighbours)
        order = sorted(range(len(places)), key=lambda k: -new[k])
        able = sorted(order, key=lambda k: evaluated[k].violation)
        fittest = sorted(evaluated, key=lambda e: e.merit, reverse=True)
        again = round(self.plan.allocation.reevaluated * len(evaluated))
        grown = (*archive, *(places[k] for k in order[: self.settings.added]))
        return Explored(
            parents=tuple(parent_of(evaluated[k]) for k in able),
            fittest=tuple(parent_of(e) for e in fittest[:again]),
            archive=grown[max(0, len(grown) - self.settings.archive) :],
        )


def novelty(places: Places, archive: Places, neighbours: int) -> list[float]:
    """The mean distance of each descriptor to its nearest neighbours.

    Args:
        places: descriptors, at least one.
        archive: further descriptors that can be neighbours.
        neighbours: number of nearest neighbours in the mean, >= 1; fewer if there are no more.

    Returns:
        A mean distance for each of `places`, >= 0.
    """
    pool = np.array([*places, *archive])
    count = min(neighbours, len(pool) - 1)
    novelties = []
    for k in range(len(places)):
        squares = (pool - pool[k]) ** 2
        distances = np.sqrt(squares.sum(axis=1))
        distances[k] = np.inf  # it is not its own neighbour
        distances.sort()
        novelties.append(float(distances[:count].mean()) if count else 0.0)
    return novelties
