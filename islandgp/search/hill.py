"""A (1 + lambda) hill climber: one parent, and its children beside it in the same worlds.

The parent is evaluated again in each generation, so that it does not live on the luck of one
world. A child that is better in these worlds takes its place. The (1 + lambda) evolution strategy
is of Rechenberg 1973 and Schwefel 1975; O'Reilly and Oppacher 1994 (PPSN III) compare hill
climbing with genetic programming.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel

from islandgp.gp.plan import Plan
from islandgp.gp.population import EditedTree, Evaluated, Individual, Tree
from islandgp.search.base import Advice, SearchContext, SearchState
from islandgp.search.breeding import Breeding, Parent, first_generation, next_generation
from islandgp.seeding import Streams


class HillSettings(BaseModel, frozen=True, extra="forbid"):
    """How children are made; they have one parent."""

    breeding: Breeding


@dataclass(frozen=True, slots=True)
class Summit:
    """What is climbed from."""

    parent: Parent  # of the next generation
    given: Tree | None  # of the supervisor, to inject
    edited: tuple[EditedTree, ...] = ()  # of the supervisor


class Hill:
    """See the module."""

    Settings = HillSettings
    Memory: ClassVar[Any] = Summit
    uses: ClassVar[frozenset[str]] = frozenset({"tree", "edits"})

    @classmethod
    def make(cls, settings: HillSettings, context: SearchContext) -> Hill:
        """See `Search`."""
        return cls(settings, context.plan)

    def __init__(self, settings: HillSettings, plan: Plan) -> None:
        self.settings = settings
        self.plan = plan

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
        """See `Search`."""
        memory: Summit | None = state.memory
        if memory is None:
            return first_generation(self.plan, streams, self.settings.breeding)

        def pick(_: np.random.Generator) -> tuple[Parent, Sequence[Parent]]:
            return memory.parent, ()

        return next_generation(
            self.plan,
            streams,
            state.generation,
            again=[memory.parent],
            tree=memory.given,
            edited=memory.edited,
            pick=pick,
            how=self.settings.breeding,
        )

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """See `Search`. Of equals the first stays: the parent, which has slot 0."""
        best = max(evaluated, key=lambda e: e.merit).individual
        return SearchState(
            state.generation + 1, Summit(Parent(best.id, best.tree), advice.tree, advice.edited)
        )
