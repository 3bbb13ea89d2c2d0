"""The control without inheritance: each individual is a new random tree.

The difference of a search to this control is the effect of selection and variation. Random search
is the usual baseline of genetic programming, e.g. in Langdon and Poli 2002, Foundations of Genetic
Programming.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import NoneType
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.core.node import Node, within
from islandgp.gp.branches import random_list
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual, Origin
from islandgp.gp.random_trees import random_tree
from islandgp.search.base import SearchContext, SearchState
from islandgp.search.breeding import TRIES
from islandgp.seeding import Stream, Streams


class RandomSearchSettings(BaseModel, frozen=True, extra="forbid"):
    """Settings of the random trees."""

    lists: float = Field(ge=0, le=1)  # share of priority lists; others are grown by `gp.trees`
    reads: ClassVar = ("gp.trees",)


class RandomSearch:
    """Evaluates new random trees in each generation; has no memory."""

    Settings = RandomSearchSettings
    Memory: ClassVar[Any] = NoneType
    uses: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    def make(cls, settings: RandomSearchSettings, context: SearchContext) -> RandomSearch:
        """See `Search`."""
        return cls(settings, context.plan)

    def __init__(self, settings: RandomSearchSettings, plan: Plan) -> None:
        self.settings = settings
        self.plan = plan

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
        """See `Search`. The first population is that of `search=paper`."""
        return tuple(self.ask_each(state, streams))

    def ask_each(self, state: SearchState, streams: Streams) -> Iterator[Individual]:
        """See `StreamingSearch`."""
        g, n = state.generation, self.plan.gp.population
        founders = self.plan.founders[:n] if g == 0 else ()
        for slot, tree in enumerate(founders):
            yield Individual(f"{g}.{slot}", tree, Origin.INJECTED)
        purpose = Stream.DIVERSITY if g else Stream.INITIAL  # the streams of `search=paper`
        for slot in range(len(founders), n):
            tree = self._tree(streams(purpose, generation=g, slot=slot))
            yield Individual(f"{g}.{slot}", tree, Origin.RANDOM)

    def _tree(self, rng: np.random.Generator) -> Node:
        if self.settings.lists and rng.random() < self.settings.lists:
            for _ in range(TRIES):
                tree = random_list(rng, self.plan.space)
                if within(tree, self.plan.gp.limits):
                    return tree
        return random_tree(rng, self.plan.space)

    def tell(
        self,
        state: SearchState,
        evaluated: Sequence[Evaluated],  # noqa: ARG002 -- the protocol's
        advice: Advice,  # noqa: ARG002 -- the protocol's
    ) -> SearchState:
        """See `Search`. Outcomes and advice have no effect."""
        return SearchState(state.generation + 1)
