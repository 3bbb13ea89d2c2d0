"""A (1 + lambda) hill climber: one parent, and its children beside it in the same worlds.

The parent is evaluated again in each generation, so that it does not live on the luck of one
world. A child that is better in these worlds takes its place. The (1 + lambda) evolution strategy
is of Rechenberg 1973 and Schwefel 1975; O'Reilly and Oppacher 1994 (PPSN III) compare hill
climbing with genetic programming.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from islandgp.gp.population import Evaluated
from islandgp.search.base import SearchState
from islandgp.search.breeding import BreedingSearch, BreedingSettings, Brood, Parent, parent_of


class Hill(BreedingSearch[BreedingSettings]):
    """See the module."""

    Settings = BreedingSettings
    Memory: ClassVar[Any] = Parent  # of the next generation

    def brood(self, state: SearchState) -> Brood:
        """See `BreedingSearch`."""
        parent: Parent = state.memory
        return Brood(pick=lambda _: (parent, ()), reevaluated=[parent])

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Parent:  # noqa: ARG002 -- the fittest alone counts
        """The fittest. Of equals the first stays: the parent, which has slot 0."""
        return parent_of(max(evaluated, key=lambda e: e.merit))
