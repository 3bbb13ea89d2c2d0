"""A (1 + lambda) hill climber: a parent and its children, evaluated in the same worlds.

The parent is evaluated again in each generation, so it does not survive by luck in one world. A
child that is better in these worlds replaces it. The (1 + lambda) evolution strategy: Rechenberg
1973 and Schwefel 1975; O'Reilly and Oppacher 1994 (PPSN III) compare hill climbing with genetic
programming.
"""

from __future__ import annotations

from islandgp.search.base import SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    BreedingSettings,
    GenerationPlan,
    NewSlots,
    parent_of,
)


class Hill(BreedingSearch[BreedingSettings]):
    """The (1 + lambda) evolution strategy; see the module."""

    Settings = BreedingSettings
    Allocation = NewSlots

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`. The fittest is the parent; of equals the first, with slot 0."""
        parent = parent_of(max(state.memory.population, key=lambda e: e.merit))
        return GenerationPlan(pick=lambda _: (parent, ()), reevaluated=[parent])
