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
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.core.node import Node, size
from islandgp.gp.evidence import estimate
from islandgp.gp.plan import Plan
from islandgp.gp.population import (
    EditedTree,
    Evaluated,
    Individual,
    Origin,
    Tree,
    edited_individuals,
)
from islandgp.scoring.constraints import (
    NO_COUNTERS,
    Merit,
    limited,
    merit,
    running_mean,
    violation,
)
from islandgp.search.base import Advice, SearchContext, SearchState
from islandgp.search.breeding import Breeding, Parent, children, digest, random_individuals
from islandgp.search.compose import priority_lists
from islandgp.search.lexicase import Contender, contender, eligible, selected
from islandgp.seeding import Stream, Streams


class RacingSettings(BaseModel, frozen=True, extra="forbid"):
    """How many survive, how they are compared, and how children are made."""

    random: int = Field(ge=1, le=1000)  # generations of random trees before the first children
    survivors: float = Field(gt=0, le=10)  # as a share of the population
    again: float = Field(gt=0, lt=1)  # share of the slots in which survivors are evaluated again
    library: int = Field(ge=0)  # of the first trees: priority lists of the library's branches
    caution: float = Field(ge=0)  # standard errors between a mean and its bound
    milestone: float = Field(ge=0)  # standard deviations that a milestone is worth
    behaviour: float = Field(ge=0)  # standard deviations that a behaviour is worth
    parsimony: float = Field(ge=0)  # standard deviations that a node costs
    specialists: float = Field(ge=0, le=1)
    """Share of mothers chosen by lexicase selection over the last generation's episodes.

    A tree that is far better than all others in one world has children then, whatever it earns
    in the others. Without effect where an individual has one episode.
    """
    breeding: Breeding


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
    tree: Tree | None  # of the supervisor, to inject
    tried: tuple[str, ...]  # digests of trees
    contenders: tuple[Contender, ...] = ()  # the last generation; () without specialists
    edited: tuple[EditedTree, ...] = ()  # of the supervisor


TRIED = 3000  # trees that are remembered as tried


class Racing:
    """See the module."""

    Settings = RacingSettings
    Memory: ClassVar[Any] = Evidence
    uses: ClassVar[frozenset[str]] = frozenset({"tree", "edits"})

    @classmethod
    def make(cls, settings: RacingSettings, context: SearchContext) -> Racing:
        """See `Search`."""
        library = list(context.library().values()) if settings.library else []
        return cls(settings, context.plan, library)

    def __init__(self, settings: RacingSettings, plan: Plan, library: Sequence[Node]) -> None:
        self.settings = settings
        self.plan = plan
        self.library = [Parent("", tree) for tree in library]

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0, Evidence((), None, ()))

    def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
        """See `Search`."""
        g, how = state.generation, self.settings
        memory: Evidence = state.memory
        asked = self._again(memory, g) if g else self._first(streams)
        if memory.tree is not None:
            asked.append(Individual(f"{g}.{len(asked)}", memory.tree, Origin.INJECTED))
        asked += edited_individuals(memory.edited, g, len(asked))
        slots = range(len(asked), self.plan.gp.population)
        tried = {*memory.tried, *(digest(i.tree) for i in asked)}
        common = self.plan.space, how.breeding, tried
        if g < how.random:
            return (*asked, *random_individuals(streams, g, slots, *common))
        parents = [Parent(e.id, e.tree) for e in memory.entries]
        fathers = [*parents, *self.library]

        contenders = memory.contenders
        points = np.array([c.cases for c in contenders])
        entrants = eligible(np.array([c.violation for c in contenders])) if contenders else None

        def pick(rng: np.random.Generator) -> tuple[Parent, Sequence[Parent]]:
            if contenders and rng.random() < how.specialists:
                return contenders[selected(rng, points, entrants)].parent, fathers
            return parents[min(rng.integers(len(parents), size=2))], fathers

        return (*asked, *children(streams, g, slots, pick, *common))

    def _first(self, streams: Streams) -> list[Individual]:
        """The plan's founders and priority lists of the library's branches, in generation 0."""
        n = self.plan.gp.population
        trees = list(self.plan.founders)
        if self.library:
            rng = streams(Stream.SEARCH)
            library = [parent.tree for parent in self.library]
            trees += priority_lists(rng, library, self.settings.library, self.plan.gp.limits)
        return [Individual(f"0.{k}", t, Origin.INJECTED) for k, t in enumerate(trees[: n - 1])]

    def _again(self, memory: Evidence, generation: int) -> list[Individual]:
        """Survivors that meet the generation's worlds: those with the highest upper bounds."""
        likely = self._ranked(memory.entries, 1.0)
        n = self.plan.gp.population
        most = min(max(1, round(self.settings.again * n)), n - 2 - len(memory.edited))
        return [
            Individual(f"{generation}.{slot}", e.tree, Origin.ELITE, (e.id,))
            for slot, e in enumerate(likely[:most])
        ]

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """See `Search`."""
        memory: Evidence = state.memory
        known = {digest(e.tree): e for e in memory.entries}
        keys = [digest(e.individual.tree) for e in evaluated]
        for key, e in zip(keys, evaluated, strict=True):
            counters = limited(e.outcome.counters, self.plan.constraints)
            known[key] = updated(known.get(key), e, self._bonus(e), state.generation, counters)
        ranked = distinct(self._ranked(list(known.values()), -1.0), state.generation)
        tried = tuple(dict.fromkeys((*memory.tried, *keys)))[-TRIED:]
        most = max(2, round(self.settings.survivors * self.plan.gp.population))
        kept = tuple(ranked[:most])
        several = self.settings.specialists and self.plan.gp.episodes > 1
        contenders = tuple(contender(e, e.episodes) for e in evaluated) if several else ()
        evidence = Evidence(kept, advice.tree, tried, contenders, advice.edited)
        return SearchState(state.generation + 1, evidence)

    def _bonus(self, e: Evaluated) -> float:
        """What milestones and behaviours are worth, in standard deviations.

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
    found = []
    for e in entries:
        new = e.fitness[-1][0] != generation or e.trace not in seen
        if new:
            found.append(e)
        seen.add(e.trace)
    return found
