"""The control without inheritance: each individual is a new random tree.

The trees are those that the other searches begin with, and none is evaluated twice. So the
difference of a search to this control is the effect of selection and variation. Random search is
the usual baseline of genetic programming, e.g. in Langdon and Poli 2002, Foundations of Genetic
Programming. `search=random_paper` draws the paper's random trees.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual
from islandgp.search.base import SearchContext, SearchState
from islandgp.search.breeding import (
    MAX_DIGESTS,
    GenerationPlan,
    RandomTrees,
    digest,
    new_generation,
)
from islandgp.seeding import Streams


class RandomSearchSettings(RandomTrees, frozen=True, extra="forbid"):
    """Settings of the random trees."""

    reads: ClassVar = ("gp.trees",)


@dataclass(frozen=True, slots=True)
class RandomMemory:
    """The trees evaluated so far."""

    tried: tuple[str, ...] = ()  # digests


class RandomSearch:
    """Evaluates new random trees in each generation."""

    Settings = RandomSearchSettings
    Memory: ClassVar[Any] = RandomMemory
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

    def ask(self, state: SearchState, streams: Streams) -> Iterator[Individual]:
        """See `Search`; the founders, if there are any, come first."""
        if state.memory is None:
            contents = GenerationPlan(initial_trees=self.plan.founders)
        else:
            contents = GenerationPlan(known_digests=state.memory.tried)
        unadvised = replace(state, advice=None)
        return new_generation(self.plan, streams, unadvised, contents, self.settings)

    def tell(
        self,
        state: SearchState,
        evaluated: Sequence[Evaluated],
        advice: Advice,  # noqa: ARG002 -- the protocol's
    ) -> SearchState:
        """See `Search`. Fitness and advice have no effect."""
        before = () if state.memory is None else state.memory.tried
        tried = dict.fromkeys((*before, *(digest(e.individual.tree) for e in evaluated)))
        return SearchState(state.generation + 1, RandomMemory(tuple(tried)[-MAX_DIGESTS:]))
