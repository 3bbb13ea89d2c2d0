"""A (1 + lambda) hill climber: a parent and its children, evaluated in the same worlds.

The parent is evaluated again in each generation, so it does not survive by luck in one world. A
child that is better in these worlds replaces it. The (1 + lambda) evolution strategy: Rechenberg
1973 and Schwefel 1975; O'Reilly and Oppacher 1994 (PPSN III) compare hill climbing with genetic
programming.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from islandgp.gp.population import Evaluated
from islandgp.search.base import SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    BreedingSettings,
    GenerationPlan,
    NewSlots,
    Parent,
    parent_of,
)


class Hill(BreedingSearch[BreedingSettings]):
    """The (1 + lambda) evolution strategy; see the module."""

    Settings = BreedingSettings
    Allocation = NewSlots
    Memory: ClassVar[Any] = Parent  # of the next generation

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`."""
        parent: Parent = state.memory
        return GenerationPlan(pick=lambda _: (parent, ()), reevaluated=[parent])

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Parent:  # noqa: ARG002 -- the fittest alone counts
        """The fittest individual; of equal ones the first, as the parent has slot 0."""
        return parent_of(max(evaluated, key=lambda e: e.merit))
