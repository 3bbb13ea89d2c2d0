"""Decision lists whose guards are weighted sums of keys; CMA-ES moves all numbers at once.

For each group of actions that exclude each other, a tree has one list,

    selector { when 0.4 * angle + spin > 0.1 { Left } when height + 0.8 * climb < 0 { Main } Rest }

1. With more than two actions, each is evaluated alone; the best one is the default of the list, its
   last action. A guard cuts the space of the keys in two, so no guard can describe "in all
   other cases", as an action at the front of the list would need.
2. Skeletons, which are orders of the other actions, compete by successive halving. Each has guards
   of all keys that are numbers, scaled by their ranges, and a CMA-ES that begins with random sums.
3. The remaining skeleton continues.
4. Each guard loses all keys but those with the largest weights, and CMA-ES moves the numbers that
   are left. Numbers have two digits from here on.
5. The last trees are evaluated again and again, so that the best robot is chosen by evidence.

All trees of a generation have the same worlds. CMA-ES of the numbers of policies: Heidrich-Meisner
and Igel 2009, Journal of Algorithms 64(4). Evolved decision trees with sums of observations:
Custode and Iacca 2023, doi 10.1109/ACCESS.2023.3236260.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, permutations, product
from statistics import fmean
from typing import Any, ClassVar, Final

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.analysis.shorter import rounded
from islandgp.bt.core.arithmetic import Operation, Term
from islandgp.bt.core.condition import Condition, comparison
from islandgp.bt.core.node import (
    SUCCESS,
    Node,
    ParallelArgs,
    Value,
    guarded,
    selector,
    sequence,
    within,
)
from islandgp.bt.core.parameters import MAX_MAGNITUDE, Parameter, leaf_of
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import ConfigError
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual, Origin
from islandgp.scoring.constraints import Merit
from islandgp.search.base import SearchContext, SearchState
from islandgp.seeding import Stream, Streams
from islandgp_numbers.cma import Cma, Numbers

MAX_MOVES: Final = 8  # most actions of a list; an action with arguments counts with each extreme
MAX_KEYS: Final = 40  # most keys of a guard
DIGITS: Final = (3, 2)  # of numbers, before and after pruning
MAX_ORDERS: Final = 50_000  # orders of the actions that are drawn from
OFFSET: Final = 0.1  # of a guard, in the units of its scaled sum: most values are near the middle
RECENT: Final = 3  # generations by which skeletons are compared


class DecisionListSettings(BaseModel, frozen=True, extra="forbid"):
    """The phases of the search, in shares of its generations, and the pruning of guards."""

    skeletons: int = Field(ge=1, le=64)  # orders of the actions that compete, at most
    screening: float = Field(ge=0, lt=1)  # share of the generations in which they compete
    pruning: float = Field(ge=0, lt=1)  # share after which the guards lose keys
    finals: float = Field(ge=0, lt=1)  # share at the end in which the last trees are confirmed
    keys: int = Field(ge=1, le=MAX_KEYS)  # most keys of a guard after pruning
    sigma: float = Field(gt=0, le=1)
    """Standard deviation of the numbers after pruning; the largest weight of a guard is 1."""
    reads: ClassVar = ()


@dataclass(frozen=True, slots=True)
class ListMemory:
    """The outcomes of all generations, from which the state of each CMA-ES follows."""

    merits: tuple[tuple[Merit, ...], ...] = ()  # by generation and slot
    ids: tuple[str, ...] = ()  # of the last generation


Order = tuple[tuple[Node, ...], ...]
"""By group, its actions in the order of the list."""


class Lists:
    """The trees of a vocabulary, from an order of the actions and a vector of numbers.

    The vector has, guard by guard, a weight for each key and an offset; keys are scaled to
    [-1, 1]. A guard holds if its sum is above OFFSET times its offset.
    """

    def __init__(self, vocabulary: Vocabulary, order: Order) -> None:
        self.order = order
        keys = {n: key for n, key in vocabulary.keys.items() if not (key.flag or key.words)}
        self.keys = [*keys]
        self.middle = np.array([(key.low + key.high) / 2 for key in keys.values()])
        self.half = np.array([(key.high - key.low) / 2 for key in keys.values()])
        self.guards = sum(len(moves) - 1 for moves in order)
        self.size = self.guards * (len(keys) + 1)
        used = {move.action for moves in order for move in moves}
        self.instant = all(vocabulary.action(name).statuses == {SUCCESS} for name in used)

    def tree(self, numbers: Numbers, digits: int) -> Node:
        """The tree; each guard is in canonical form: its largest weight is 1."""
        guards = iter(numbers.reshape(self.guards, -1))
        lists = []
        for moves in self.order:
            branches = [guarded(self._guard(next(guards), digits), move) for move in moves[:-1]]
            lists.append(selector(*branches, moves[-1]) if branches else moves[-1])
        if len(lists) == 1:
            return lists[0]
        if self.instant:
            return sequence(*lists)
        return alone(lists)

    def _guard(self, guard: Numbers, digits: int) -> Condition:
        *weights, offset = guard
        raw = np.array(weights) / self.half
        largest = int(np.argmax(abs(raw)))
        scale = raw[largest] or 1.0
        number = (OFFSET * offset + float(raw @ self.middle)) / scale
        total: Term = ""
        for key, weight, scaled in zip(self.keys, raw / scale, weights, strict=True):
            if abs(scaled) < 0.005 * max(map(abs, weights)) and key != self.keys[largest]:
                continue
            w = rounded(float(weight), digits)
            if not total:
                total = key if w == 1 else Operation("*", (w, key))
            else:
                part: Term = key if abs(w) == 1 else Operation("*", (abs(w), key))
                total = Operation("+" if w > 0 else "-", (total, part))
        limited = min(MAX_MAGNITUDE, max(-MAX_MAGNITUDE, rounded(number, digits)))
        return comparison(total, ">" if scale > 0 else "<", limited + 0.0)

    def kept(self, numbers: Numbers, keys: int) -> Numbers:
        """Which numbers are left if each guard keeps the keys with the largest weights."""
        kept = np.ones((self.guards, len(self.keys) + 1), bool)
        weights = abs(numbers.reshape(self.guards, -1)[:, :-1])
        for row, guard in zip(kept, weights, strict=True):
            row[np.argsort(-guard, kind="stable")[keys:]] = False
        return kept.ravel()

    def normal(self, numbers: Numbers) -> Numbers:
        """The numbers with guards divided by their largest weight."""
        guards = numbers.reshape(self.guards, -1)
        largest: Numbers = abs(guards[:, :-1]).max(axis=1, keepdims=True).clip(1e-9)
        return np.ravel(guards / largest)


def groups_of(vocabulary: Vocabulary) -> list[list[Node]]:
    """The actions, those that share a resource together; one with arguments in its extremes.

    Actions that declare no resource exclude each other.
    """
    groups: list[tuple[set[str], list[Node]]] = []
    for name, action in vocabulary.actions.items():
        joined, moves = set(action.uses or ("",)), list(_moves(name, action.arguments))
        for group in [group for group in groups if group[0] & joined]:
            groups.remove(group)
            joined, moves = joined | group[0], group[1] + moves
        groups.append((joined, moves))
    return [moves for _, moves in groups]


def _moves(name: str, arguments: Mapping[str, Parameter]) -> Iterator[Node]:
    """A leaf for each combination of extremes: the ends of ranges, and words."""
    extremes: list[Sequence[Value]] = [
        (p.low, p.high) if p.numeric else p.words or (p.default,) for p in arguments.values()
    ]
    for values in islice(product(*extremes), MAX_MOVES + 1):
        yield leaf_of(name, dict(zip(arguments, values, strict=True)), arguments)


def orders_of(groups: Sequence[Sequence[Node]], defaults: Sequence[Node]) -> Iterator[Order]:
    """All orders that end with the default action of their group."""
    return product(
        *(
            [(*order, last) for order in permutations(m for m in moves if m is not last)]
            for moves, last in zip(groups, defaults, strict=True)
        )
    )


def alone(moves: Sequence[Node]) -> Node:
    """A tree that does one action of each group in every tick."""
    if len(moves) == 1:
        return moves[0]
    return Node("parallel", ParallelArgs(failure="all"), tuple(moves))


class DecisionList:
    """Tunes decision lists; see the module."""

    Settings = DecisionListSettings
    Memory: ClassVar[Any] = ListMemory
    uses: ClassVar[frozenset[str]] = frozenset()

    @staticmethod
    def suits(vocabulary: Vocabulary, stuck: bool) -> str:  # noqa: ARG004 # of all searches
        """Why it suits a domain: all keys are numbers, and actions exclude each other; or ""."""
        if any(key.flag or key.words for key in vocabulary.keys.values()) or not any(
            len(moves) > 1 for moves in groups_of(vocabulary)
        ):
            return ""
        return "all keys are numbers here, and it moves the numbers of all guards together"

    @classmethod
    def make(cls, settings: DecisionListSettings, context: SearchContext) -> DecisionList:
        """See `Search`. Raises ConfigError for a vocabulary without numbers or choices."""
        plan = context.plan
        if plan.founders:
            raise ConfigError(
                "search=decision_list: expected no trees that open the population, found"
                f" {len(plan.founders)}; leave out start and gp.founders, or choose another search."
            )
        groups = groups_of(plan.vocabulary)
        lists = Lists(plan.vocabulary, tuple(map(tuple, groups)))
        if not 0 < len(lists.keys) <= MAX_KEYS:
            raise ConfigError(
                f"search=decision_list: expected 1 to {MAX_KEYS} keys that are numbers, found"
                f" {len(lists.keys)} in the domain {plan.vocabulary.domain}; choose another search."
            )
        if not lists.guards or max(map(len, groups)) > MAX_MOVES:
            raise ConfigError(
                f"search=decision_list: expected 2 to {MAX_MOVES} actions that exclude each other"
                " (one with arguments counts with each extreme), found"
                f" {max(map(len, groups), default=0)}; choose another search."
            )
        if not within(lists.tree(np.ones(lists.size), 1), plan.gp.limits):
            raise ConfigError(
                "search=decision_list: expected a list of all actions within gp.max_nodes and"
                " gp.max_depth, found that it is larger; raise these."
            )
        if settings.screening + settings.finals >= 1 or settings.pruning < settings.screening:
            raise ConfigError(
                "search.policy: expected screening <= pruning, and screening + finals below 1,"
                f" found {settings.screening:g}, {settings.pruning:g} and {settings.finals:g}"
            )
        return cls(settings, plan, groups)

    def __init__(
        self, settings: DecisionListSettings, plan: Plan, groups: Sequence[Sequence[Node]]
    ) -> None:
        self.settings, self.plan, self.groups = settings, plan, groups
        self._run: _Run | None = None  # of the last call of `ask`; it follows from its arguments

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
        """See `Search`."""
        memory: ListMemory = state.memory or ListMemory()
        run = self._run
        if run is None or run.streams != streams or run.told != memory.merits[: len(run.told)]:
            run = self._run = _Run(self.settings, self.plan, self.groups, streams)
        for merits in memory.merits[len(run.told) :]:
            run.tell(merits)
        origin = Origin.ELITE if run.confirmed else Origin.SAMPLED
        parents = memory.ids if run.confirmed > 1 else ()
        return tuple(
            Individual(f"{state.generation}.{slot}", tree, origin, parents[slot : slot + 1])
            for slot, tree in enumerate(run.trees)
        )

    def tell(
        self,
        state: SearchState,
        evaluated: Sequence[Evaluated],
        advice: Advice,  # noqa: ARG002 -- the protocol's
    ) -> SearchState:
        """See `Search`; the advice has no effect."""
        memory: ListMemory = state.memory or ListMemory()
        merits = (*memory.merits, tuple(e.merit for e in evaluated))
        ids = tuple(e.individual.id for e in evaluated)
        return SearchState(state.generation + 1, ListMemory(merits, ids))


class _Skeleton:
    """A skeleton with the CMA-ES of some of its numbers; the others are 0."""

    def __init__(
        self, lists: Lists, mean: Numbers, sigma: float, kept: Numbers, size: int, seed: int
    ) -> None:
        self.lists, self.kept = lists, kept
        self.cma = Cma(mean[kept], sigma, size=size, seed=seed)
        self._levels: list[Merit] = []  # mean of the better half, by generation

    def numbers(self, values: Numbers) -> Numbers:
        """All numbers of the skeleton."""
        numbers = np.zeros(self.lists.size)
        numbers[self.kept] = values
        return numbers

    @property
    def level(self) -> Merit:
        """How good the trees of the last generations are; before the first, the worst."""
        return _mean(self._levels[-RECENT:] or [(-math.inf, -math.inf)])

    def tell(self, samples: Sequence[Numbers], merits: Sequence[Merit]) -> None:
        """The outcomes of a generation."""
        self._levels.append(_mean(sorted(merits, reverse=True)[: (len(merits) + 1) // 2]))
        self.cma.tell(samples, merits)


class _Run:
    """The state of a search, which follows from its arguments and what it was told."""

    def __init__(
        self,
        settings: DecisionListSettings,
        plan: Plan,
        groups: Sequence[Sequence[Node]],
        streams: Streams,
    ) -> None:
        self.settings, self.plan, self.streams = settings, plan, streams
        self.told: tuple[tuple[Merit, ...], ...] = ()
        self.confirmed = 0  # generations, with the next one, of the finals
        self.recent: list[Node] = []  # the best trees after pruning, the newest last
        self.active: list[_Skeleton] = []
        self.pruned = False
        self.groups = groups
        self.constant: list[tuple[Node, ...]] = []  # the candidates for the defaults, if evaluated
        if max(map(len, groups)) > 2:
            every = [*islice(product(*groups), MAX_ORDERS)]
            chosen = streams(Stream.SEARCH).permutation(len(every))[: plan.gp.population]
            self.constant = [every[at] for at in chosen]
            self.trees = [alone(moves) for moves in self.constant]
        else:  # of two actions, either may be the default, as guards can be negated
            self._enter([moves[-1] for moves in groups])

    def _enter(self, defaults: Sequence[Node]) -> None:
        """The skeletons that compete."""
        orders = list(islice(orders_of(self.groups, defaults), MAX_ORDERS))
        chosen = self.streams(Stream.SEARCH).permutation(len(orders))[: self.settings.skeletons]
        for slot, at in enumerate(chosen):
            lists = Lists(self.plan.vocabulary, orders[at])
            every = np.ones(lists.size, bool)
            self.active.append(self._skeleton(lists, np.zeros(lists.size), 1.0, every, slot))
        self.entrants = len(self.active)
        self._sample()

    def _skeleton(
        self, lists: Lists, mean: Numbers, sigma: float, kept: Numbers, slot: int
    ) -> _Skeleton:
        seed = int(self.streams(Stream.SEARCH, slot=slot + 1).integers(2**32))
        return _Skeleton(lists, mean, sigma, kept, self.plan.gp.population, seed)

    def _sample(self) -> None:
        """Samples the next trees, of the active skeletons in turn."""
        self.current = self.active[len(self.told) % len(self.active)]
        self.samples = self.current.cma.ask()
        self.trees = [self._tree(values) for values in self.samples]

    def _tree(self, values: Numbers) -> Node:
        return self.current.lists.tree(self.current.numbers(values), DIGITS[self.pruned])

    def tell(self, merits: tuple[Merit, ...]) -> None:
        """The outcomes of `trees`; then `trees` are those of the next generation."""
        self.told = (*self.told, merits)
        if self.confirmed:
            self.confirmed += 1
            return
        best = max(range(len(merits)), key=merits.__getitem__)
        if not self.active:
            self._enter(self.constant[best])
            return
        self.current.tell(self.samples, merits)
        done, settings = len(self.told) / self.plan.gp.generations, self.settings
        if self.pruned:
            self.recent += [self.trees[best], self._tree(self.current.cma.mean)]
        halvings = (self.entrants - 1).bit_length()
        if done < settings.screening:
            halvings = int(halvings * done / settings.screening)
        while len(self.active) > -(-self.entrants >> halvings):
            self.active.remove(min(self.active, key=lambda each: each.level))
        if not self.pruned and done >= settings.pruning:
            self._prune(self.samples[best])
        if self.pruned and self.recent and done >= 1 - settings.finals:
            distinct = dict.fromkeys(reversed(self.recent))
            self.trees = [*distinct][: self.plan.gp.population]
            self.confirmed = 1
        else:
            self._sample()

    def _prune(self, best: Numbers) -> None:
        """Continues with the keys of the largest weights of the one skeleton that is left."""
        (before,) = self.active
        lists, mean = before.lists, before.cma.mean if before.cma.generation else best
        mean = lists.normal(before.numbers(mean))
        kept = lists.kept(mean, self.settings.keys)
        slot = self.settings.skeletons
        self.active = [self._skeleton(lists, mean, self.settings.sigma, kept, slot)]
        self.pruned = True


def _mean(merits: Sequence[Merit]) -> Merit:
    violations, points = zip(*merits, strict=True)
    return fmean(violations), fmean(points)
