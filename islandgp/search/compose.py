"""The control without evolution: the library's branches as a priority list in the best order.

A race by successive halving selects the order. The difference of a search to this control is what
evolution adds to the library.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice, permutations
from math import factorial
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import FAILURE, Limits, Node, selector, within
from islandgp.errors import ConfigError
from islandgp.gp.evidence import Evidence, with_evaluation
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual, Origin, Proposal, in_slots
from islandgp.gp.selection import halved
from islandgp.scoring.constraints import Merit, limited, merit, violation
from islandgp.search.base import SearchContext, SearchState
from islandgp.seeding import Rng, Stream, Streams


def library_branches(library: Sequence[Node]) -> tuple[list[Node], list[Node]]:
    """The guarded branch of each tree, and the most frequent last branch without a guard.

    Args:
        library: trees. Of a selector the first guarded child is its branch; any other tree is a
            branch as a whole.

    Returns:
        The branches, each once, and a list of one fallback, or of none.
    """
    branches, fallbacks = [], Counter[Node]()
    for tree in library:
        guarded = (
            [c for c in tree.children if c.guard] if kind_of(tree).advance_status == FAILURE else []
        )
        branches.append(guarded[0] if guarded else tree)
        if guarded and not tree.children[-1].guard:
            fallbacks[tree.children[-1]] += 1
    return list(dict.fromkeys(branches)), [node for node, _ in fallbacks.most_common(1)]


def priority_lists(rng: Rng, library: Sequence[Node], count: int, limits: Limits) -> list[Node]:
    """Selectors of the library's branches and its fallback branch, in different orders.

    Args:
        rng: draws orders if there are more than `count`; the generator is consumed.
        library: trees.
        count: maximum number of lists, >= 0.
        limits: lists that exceed them are left out.
    """
    branches, fallback = library_branches(library)
    n = len(branches)
    if factorial(n) <= count:
        orders = list(permutations(range(n)))
    else:
        draws = (tuple(int(k) for k in rng.permutation(n)) for _ in range(20 * count))
        orders = list(islice(dict.fromkeys(draws), count))
    lists = (selector(*(branches[k] for k in order), *fallback) for order in orders)
    return [tree for tree in lists if within(tree, limits)]


class ComposeSettings(BaseModel, frozen=True, extra="forbid"):
    """Number of orders in the race."""

    orders: int = Field(ge=1)  # at most
    finalists: int = Field(ge=1)  # that race to the end
    reads: ClassVar = ("library",)


@dataclass(frozen=True, slots=True)
class Racers:
    """The lists that remain in the race, best first."""

    lists: tuple[Evidence, ...]


class Compose:
    """Successive halving: the worse half of the orders is dropped after each generation."""

    Settings = ComposeSettings
    Memory: ClassVar[Any] = Racers
    uses: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    def make(cls, settings: ComposeSettings, context: SearchContext) -> Compose:
        """See `Search`. Raises ConfigError without a library folder, or with founders."""
        if context.plan.founders:
            raise ConfigError(
                "search=compose: expected only the library's branches, found trees that open the"
                " population; leave out start and gp.founders, or choose another search."
            )
        library = list(context.library().values())
        if not library:
            raise ConfigError(
                "search=compose: expected a library with a folder, found none; choose one, e.g."
                " library.folder=FOLDER, or another search."
            )
        if not priority_lists(np.random.default_rng(0), library, 1, context.plan.gp.limits):
            raise ConfigError(
                "search=compose: expected branches that fit into one tree, found that they"
                " break gp.max_nodes or gp.max_depth; raise these."
            )
        return cls(settings, context.plan, library)

    def __init__(self, settings: ComposeSettings, plan: Plan, library: Sequence[Node]) -> None:
        self.settings = settings
        self.plan = plan
        self.library = library

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> Iterator[Individual]:
        """See `Search`."""
        if state.memory is not None:
            again = (Proposal(each.tree, Origin.ELITE, (each.id,)) for each in state.memory.lists)
            return in_slots(again, state.generation)
        count = min(self.settings.orders, self.plan.gp.population)
        lists = priority_lists(streams(Stream.SEARCH), self.library, count, self.plan.gp.limits)
        return in_slots((Proposal(tree, Origin.INJECTED) for tree in lists), 0)

    def tell(
        self,
        state: SearchState,
        evaluated: Sequence[Evaluated],
        advice: Advice,  # noqa: ARG002 -- the protocol's
    ) -> SearchState:
        """See `Search`; the advice has no effect."""
        before = state.memory.lists if state.memory else (None,) * len(evaluated)
        limits = self.plan.constraints
        lists = [
            with_evaluation(old, e, state.generation, limited(e.outcome.counters, limits))
            for old, e in zip(before, evaluated, strict=True)
        ]

        def rank(each: Evidence) -> Merit:
            points = sum(points for _, points in each.fitness)
            return merit(points, violation(each.means, limits))

        ranked = sorted(lists, key=rank, reverse=True)
        remaining = ranked[: halved(len(ranked), self.settings.finalists)]
        return SearchState(state.generation + 1, Racers(tuple(remaining)))
