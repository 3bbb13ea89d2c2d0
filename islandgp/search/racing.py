"""A (mu + lambda) evolution strategy over trees, with survivors chosen by confidence bounds.

The survivors are the parents and children with the highest lower confidence bounds on their mean
fitness over all their episodes. Each generation evaluates

- a few survivors again in new worlds, those with the highest upper bounds;
- the supervisor's trees;
- children in the other slots, or random trees in the first `random_generations`.

So a tree does not survive by luck in one world, and is not evaluated twice in the same worlds.

With `restarts` above 1, populations begin from random trees in turn, and the best trees of all of
them breed together at the end. A population often keeps the combination of behaviours
that it had early, so restarts give a large budget several chances.

Survivors without duplicates, and fitness as a mean of reruns: Iovino et al. 2021, arXiv
2011.03252. The upper bound is that of racing (Maron and Moore 1994) and bandits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, ClassVar, Final, Self

from pydantic import Field, FiniteFloat

from islandgp.bt.core.node import Node, size
from islandgp.errors import ConfigError
from islandgp.gp.evidence import Evidence, digest, estimate
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated
from islandgp.gp.selection import by_rank
from islandgp.scoring.constraints import Merit, limited, merit, violation
from islandgp.search.base import SearchContext, SearchState
from islandgp.search.breeding import (
    MAX_DIGESTS,
    BreedingSearch,
    BreedingSettings,
    GenerationPlan,
    Parent,
    Pick,
    Slots,
    evidence_by_digest,
)
from islandgp.search.compose import priority_lists
from islandgp.search.lexicase import lexicase_draw
from islandgp.seeding import Rng, Stream, Streams


class RacingSettings(BreedingSettings, frozen=True):
    """Number of survivors, their comparison, and the making of children.

    `milestone`, `behaviour` and `parsimony` are in residual standard deviations: those of a single
    evaluation around its tree's level, as `gp.evidence.estimate` returns them.
    """

    random_generations: int = Field(ge=1, le=1000)
    """Generations of random trees at the start of a population, before its first children."""
    restarts: int = Field(ge=1, le=100)  # populations that begin from random trees, in turn
    joint: float = Field(ge=0, lt=1)
    """Share of the generations in which the best trees of all restarts breed together, at the end.

    It has no effect with one restart.
    """
    survivors: float = Field(gt=0, le=10)  # as a share of the population
    library: int = Field(ge=0)  # first trees that are priority lists of the library's branches
    bound_width: FiniteFloat = Field(ge=0)  # standard errors between a tree's level and its bounds
    shrinkage: FiniteFloat = Field(ge=0)
    """Variance of a tree's evaluations over that of the generations' worlds.

    The larger it is, the nearer are the trees' levels to plain means of their evaluations.
    """
    milestone: FiniteFloat = Field(ge=0)  # bonus for each milestone reached
    behaviour: FiniteFloat = Field(ge=0)  # bonus for each behaviour shown
    parsimony: FiniteFloat = Field(ge=0)  # cost of each node
    specialists: float = Field(ge=0, le=1)
    """Share of mothers chosen by lexicase selection over the last generation's episodes.

    Lexicase selection favours trees that are best in some world even if they are poor in others.
    It needs `gp.episodes` > 1, and has no effect otherwise.
    """

    @property
    def reads(self) -> tuple[str, ...]:
        """See `Search`."""
        return ("gp.trees", "library") if self.library else ("gp.trees",)


BONUS: Final = " bonus"  # among the means of a tree, beside its counters with a constraint


@dataclass(frozen=True, slots=True)
class RacingMemory:
    """The survivors, best first, and the trees evaluated so far."""

    entries: tuple[Evidence, ...]
    tried: tuple[str, ...]  # digests of trees
    began: int = 0  # generation in which this population began
    champions: tuple[Evidence, ...] = ()  # the best trees of earlier restarts
    last: tuple[Evaluated, ...] = ()  # the last generation; () without specialists


class Racing(BreedingSearch[RacingSettings]):
    """Keeps the trees with the highest lower bounds; see the module."""

    Settings = RacingSettings
    Allocation = Slots
    Memory: ClassVar[Any] = RacingMemory

    @classmethod
    def make(cls, settings: RacingSettings, context: SearchContext) -> Self:
        """See `Search`.

        Raises:
            ConfigError: a restart has no generation of children, or the library is not valid.
            TreeError: a tree of the library is not valid.
        """
        length, shortest = restart_length(settings, context.plan), settings.random_generations + 1
        if settings.restarts > 1 and length < shortest:
            raise ConfigError(
                f"search.policy.restarts: expected restarts of at least {shortest} generations (one"
                f" more than search.policy.random_generations), found {length}; lower restarts, or"
                " raise gp.generations or budget.episodes"
            )
        library = context.library() if settings.library else {}
        return cls(settings, context.plan, list(library.values()))

    def __init__(self, settings: RacingSettings, plan: Plan, library: Sequence[Node]) -> None:
        super().__init__(settings, plan)
        self.library_parents = [Parent("", tree) for tree in library]
        self.restart_length = restart_length(settings, plan)

    def plan_first(self, streams: Streams) -> GenerationPlan:
        """The plan's founders, priority lists of the library's branches, and random trees."""
        trees = list(self.plan.founders)
        if self.library_parents:
            rng, count = streams(Stream.SEARCH), self.settings.library
            library_trees = [parent.tree for parent in self.library_parents]
            trees += priority_lists(rng, library_trees, count, self.plan.gp.limits)
        # The last slot is left to a random tree.
        return GenerationPlan(initial_trees=trees[: self.plan.gp.population - 1])

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`. Survivors with the highest upper bounds are evaluated again."""
        memory: RacingMemory = state.memory
        promising = self._ranked(memory.entries, 1.0)
        slots = round(self.plan.allocation.reevaluated * self.plan.gp.population)
        young = state.generation - memory.began < self.settings.random_generations
        pick = None if young else self._pick(memory)
        rerun = [Parent(entry.id, entry.tree) for entry in promising[:slots]]
        return GenerationPlan(pick, reevaluated=rerun, known_digests=memory.tried)

    def _pick(self, memory: RacingMemory) -> Pick:
        """The draw of parents.

        The mother is a survivor by rank, or a specialist by lexicase selection. The candidates for
        the father are all survivors and the library's trees.
        """
        parents = [Parent(entry.id, entry.tree) for entry in memory.entries]
        fathers = [*parents, *self.library_parents]
        last = memory.last
        specialist = lexicase_draw(last, [e.episodes for e in last]) if last else None

        def pick(rng: Rng) -> tuple[Parent, Sequence[Parent]]:
            if specialist is not None and rng.random() < self.settings.specialists:
                return specialist(rng), fathers
            return by_rank(rng, parents), fathers

        return pick

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> RacingMemory:
        """See `BreedingSearch`."""
        memory: RacingMemory = state.memory or RacingMemory((), ())
        entries = evidence_by_digest(memory.entries, evaluated, state.generation, self._values)
        keys = [digest(e.individual.tree) for e in evaluated]
        ranked = distinct(self._ranked(list(entries.values()), -1.0), state.generation)
        survivor_count = max(2, round(self.settings.survivors * self.plan.gp.population))
        lexicase = self.settings.specialists and self.plan.gp.episodes > 1
        after = replace(
            memory,
            entries=tuple(ranked[:survivor_count]),
            tried=tuple(dict.fromkeys((*memory.tried, *keys)))[-MAX_DIGESTS:],
            last=tuple(evaluated) if lexicase else (),
        )
        return self._after_restart(after, state.generation + 1)

    def _after_restart(self, memory: RacingMemory, generation: int) -> RacingMemory:
        """The memory for `generation`.

        Empty at a restart. After the last restart, its entries are the best of all restarts.
        """
        restarts, length = self.settings.restarts, self.restart_length
        if restarts == 1 or generation % length or generation > restarts * length:
            return memory
        best = memory.entries[: max(1, len(memory.entries) // restarts)]
        champions = (*memory.champions, *best)
        if generation < restarts * length:
            return RacingMemory((), memory.tried, began=generation, champions=champions)
        return replace(memory, entries=tuple(self._ranked(champions, -1.0)), champions=())

    def _values(self, e: Evaluated) -> dict[str, float]:
        """The counters with a constraint, and the bonuses in residual standard deviations.

        Milestones and behaviours are steps towards a good robot that may cost points at first.
        """
        classes, settings = self.plan.classes, self.settings
        milestones = len(set(e.labels.tiers) & set(classes.milestones))
        behaviours = len(classes.behaviours_of(e.outcome.counters))
        bonus = settings.milestone * milestones + settings.behaviour * behaviours
        return {BONUS: bonus, **limited(e.outcome.counters, self.plan.constraints)}

    def _ranked(self, entries: Sequence[Evidence], sign: float) -> list[Evidence]:
        """The entries by the lower confidence bound (`sign` -1) or the upper one (1), best first.

        The bound is that of the tree's level, with its bonus and the cost of its nodes. Entries
        that keep the constraints, by means over all episodes, come before all others.
        """
        settings = self.settings
        levels, sd = estimate([dict(entry.fitness) for entry in entries], settings.shrinkage)

        def bound(k: int) -> Merit:
            entry = entries[k]
            bonus = entry.means[BONUS] - settings.parsimony * size(entry.tree)
            half_width = settings.bound_width / sqrt(len(entry.fitness))
            points = levels[k] + sd * (bonus + sign * half_width)
            return merit(points, violation(entry.means, self.plan.constraints))

        return [entries[k] for k in sorted(range(len(entries)), key=bound, reverse=True)]


def restart_length(settings: RacingSettings, plan: Plan) -> int:
    """Generations of each restart: those before the joint ones, in equal parts, rounded down."""
    return round(plan.gp.generations * (1 - settings.joint)) // settings.restarts


def distinct(entries: Sequence[Evidence], generation: int) -> list[Evidence]:
    """The entries without those of this generation that earned the same points as a better one.

    Args:
        entries: best first.
        generation: that was evaluated last.
    """
    outcome_keys: set[str] = set()
    remaining = []
    for entry in entries:
        if entry.fitness[-1][0] != generation or entry.outcome_key not in outcome_keys:
            remaining.append(entry)
        outcome_keys.add(entry.outcome_key)
    return remaining
