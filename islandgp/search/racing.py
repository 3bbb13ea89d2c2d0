"""Survivors among parents and children, by the mean of all episodes that a tree has had.

A (mu + lambda) evolution strategy over trees. Each generation holds survivors that meet new
worlds, and new children; whoever has the higher lower bound survives. So an elite does not live
on the luck of one world, and no tree is evaluated twice in the same worlds. Survivors among
parents and children without duplicates, with fitness as a mean of reruns: Iovino et al. 2021,
arXiv 2011.03252. Who is evaluated again is chosen by an upper bound, as in racing (Maron and
Moore 1994) and bandits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import Any, ClassVar, Final, Self

import numpy as np
from pydantic import Field, FiniteFloat

from islandgp.bt.core.node import Node, size
from islandgp.gp.evidence import estimate
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated, Tree
from islandgp.gp.selection import by_rank
from islandgp.scoring.constraints import (
    NO_COUNTERS,
    Merit,
    limited,
    merit,
    running_mean,
    violation,
)
from islandgp.search.base import SearchContext, SearchState
from islandgp.search.breeding import BreedingSearch, BreedingSettings, Brood, Parent, Pick, digest
from islandgp.search.compose import priority_lists
from islandgp.search.lexicase import Contender, contender, lexicase_draw
from islandgp.seeding import Stream, Streams


class RacingSettings(BreedingSettings, frozen=True):
    """Number of survivors, their comparison, and the making of children."""

    random: int = Field(ge=1, le=1000)  # generations of random trees before the first children
    survivors: float = Field(gt=0, le=10)  # as a share of the population
    again: float = Field(gt=0, lt=1)  # share of the slots in which survivors are evaluated again
    library: int = Field(ge=0)  # of the first trees: priority lists of the library's branches
    caution: FiniteFloat = Field(ge=0)  # standard errors between a mean and its bound
    milestone: FiniteFloat = Field(ge=0)  # standard deviations that a milestone is worth
    behaviour: FiniteFloat = Field(ge=0)  # standard deviations that a behaviour is worth
    parsimony: FiniteFloat = Field(ge=0)  # standard deviations that a node costs
    specialists: float = Field(ge=0, le=1)
    """Share of mothers chosen by lexicase selection over the last generation's episodes.

    Lexicase selection favours trees that are best in some world even if they are poor in others.
    No effect with one episode per individual.
    """


@dataclass(frozen=True, slots=True)
class Entry:
    """A tree with the evidence for it."""

    id: str  # of its last individual
    tree: Tree
    fitness: tuple[tuple[int, float], ...]  # (generation, points), oldest first
    bonus: float  # for milestones and behaviours, in standard deviations; mean over these
    trace: str  # of its last outcome: two trees with equal traces did the same
    counters: dict[str, float] = field(default_factory=dict)  # with limits, mean over these


@dataclass(frozen=True, slots=True)
class Evidence:
    """The survivors, best first, and what was tried."""

    entries: tuple[Entry, ...]
    tried: tuple[str, ...]  # digests of trees
    contenders: tuple[Contender, ...] = ()  # the last generation; () without specialists


TRIED: Final = 3000  # digests of trees that are kept, the last ones


class Racing(BreedingSearch[RacingSettings]):
    """See the module."""

    Settings = RacingSettings
    Memory: ClassVar[Any] = Evidence

    @classmethod
    def make(cls, settings: RacingSettings, context: SearchContext) -> Self:
        """See `Search`."""
        library = context.library() if settings.library else {}
        return cls(settings, context.plan, list(library.values()))

    def __init__(self, settings: RacingSettings, plan: Plan, library: Sequence[Node]) -> None:
        super().__init__(settings, plan)
        self.library = [Parent("", tree) for tree in library]

    def first(self, streams: Streams) -> Brood:
        """The plan's founders, priority lists of the library's branches, and random trees."""
        trees = list(self.plan.founders)
        if self.library:
            rng, most = streams(Stream.SEARCH), self.settings.library
            library = [parent.tree for parent in self.library]
            trees += priority_lists(rng, library, most, self.plan.gp.limits)
        return Brood(written=trees[: self.plan.gp.population - 1])

    def brood(self, state: SearchState) -> Brood:
        """See `BreedingSearch`. Survivors with the highest upper bounds are evaluated again."""
        memory: Evidence = state.memory
        likely = self._ranked(memory.entries, 1.0)
        most = max(1, round(self.settings.again * self.plan.gp.population))
        pick = None if state.generation < self.settings.random else self._pick(memory)
        return Brood(pick, again=[Parent(e.id, e.tree) for e in likely[:most]], tried=memory.tried)

    def _pick(self, memory: Evidence) -> Pick:
        """Mothers are survivors, or by lexicase selection specialists of the last generation."""
        parents = [Parent(e.id, e.tree) for e in memory.entries]
        fathers = [*parents, *self.library]
        specialist = lexicase_draw(memory.contenders) if memory.contenders else None

        def pick(rng: np.random.Generator) -> tuple[Parent, Sequence[Parent]]:
            if specialist is not None and rng.random() < self.settings.specialists:
                return specialist(rng), fathers
            return by_rank(rng, parents), fathers

        return pick

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Evidence:
        """See `BreedingSearch`."""
        memory: Evidence = state.memory or Evidence((), ())
        known = {digest(e.tree): e for e in memory.entries}
        keys = [digest(e.individual.tree) for e in evaluated]
        for key, e in zip(keys, evaluated, strict=True):
            counters = limited(e.outcome.counters, self.plan.constraints)
            known[key] = updated(known.get(key), e, self._bonus(e), state.generation, counters)
        ranked = distinct(self._ranked(list(known.values()), -1.0), state.generation)
        most = max(2, round(self.settings.survivors * self.plan.gp.population))
        several = self.settings.specialists and self.plan.gp.episodes > 1
        return Evidence(
            tuple(ranked[:most]),
            tuple(dict.fromkeys((*memory.tried, *keys)))[-TRIED:],
            tuple(contender(e, e.episodes) for e in evaluated) if several else (),
        )

    def _bonus(self, e: Evaluated) -> float:
        """Bonuses for milestones and behaviours, in standard deviations.

        Both are steps towards a good robot that may cost points at first.
        """
        classes, how = self.plan.classes, self.settings
        reached = len(set(e.labels.tiers) & set(classes.milestones))
        return how.milestone * reached + how.behaviour * len(classes.shown(e.outcome.counters))

    def _ranked(self, entries: Sequence[Entry], side: float) -> list[Entry]:
        """Best first, by a bound of an entry's worth: the lower for side=-1, the upper for 1.

        Constraints come first, by the means over all episodes.
        """
        how = self.settings
        levels, sd = estimate([dict(e.fitness) for e in entries])

        def bound(k: int) -> Merit:
            e = entries[k]
            worth = e.bonus - how.parsimony * size(e.tree)
            points = levels[k] + sd * (worth + side * how.caution / sqrt(len(e.fitness)))
            return merit(points, violation(e.counters, self.plan.constraints))

        return [entries[k] for k in sorted(range(len(entries)), key=bound, reverse=True)]


def updated(
    before: Entry | None,
    e: Evaluated,
    bonus: float,
    generation: int,
    counters: Mapping[str, float] = NO_COUNTERS,
) -> Entry:
    """The entry of a tree with one more evaluation; `counters` are those with limits."""
    i = e.individual
    trace = repr((e.fitness, sorted(e.outcome.components.items())))
    now = (generation, e.fitness)
    if before is None:
        return Entry(i.id, i.tree, (now,), bonus, trace, dict(counters))
    n = len(before.fitness) + 1
    mean = before.bonus + (bonus - before.bonus) / n
    return replace(
        before,
        id=i.id,
        fitness=(*before.fitness, now),
        bonus=mean,
        trace=trace,
        counters=running_mean(before.counters, counters, n),
    )


def distinct(entries: Sequence[Entry], generation: int) -> list[Entry]:
    """Without trees of this generation that did exactly the same as one before them in the list."""
    seen: set[str] = set()
    trees = []
    for e in entries:
        new = e.fitness[-1][0] != generation or e.trace not in seen
        if new:
            trees.append(e)
        seen.add(e.trace)
    return trees
