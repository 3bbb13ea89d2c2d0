"""Shortens a tree as far as its fitness, tiers and constraints allow.

Trees of genetic programming carry nodes without effect (bloat). `Shortening` tries shorter forms of
a tree in the same worlds as the tree itself and keeps those without a loss, by a sequential test: a
form that loses clearly in a few worlds is rejected there. The nodes that run least are removed
first, many at once while that holds, as in delta debugging (Zeller and Hildebrandt 2002,
Simplifying and Isolating Failure-Inducing Input). The result is a front of trees from the
longest to the shortest. As each of them was chosen in the worlds in which it was tried, `prune`
evaluates the front in fresh worlds and returns the shortest tree that holds there as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import ceil, sqrt
from statistics import fmean, stdev
from typing import Final, TypeAlias

from pydantic import BaseModel, Field

from islandgp.bt.analysis.shorter import (
    ShorterForm,
    freed_forms,
    removable,
    removal,
    rounded_forms,
    shorter_forms,
    without,
)
from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.node import Node, size
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domain import Outcome
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import Constraints, mean_violation
from islandgp.scoring.explain import Evaluate, Run, usage

FIRST: Final = 4  # worlds in which every form is tried
BATCH: Final = 4  # forms that are tried at once
OBSERVED: Final = 6  # worlds in which it is counted how often each node runs
NEEDED: Final = 0.1  # a form that loses this share of the fitness is tried once only
LOST_SHARE: Final = 0.05  # of the worlds in which a tier or behaviour may be lost
FRONT: Final = 8  # most trees of a front that are confirmed
SEARCH_SHARE: Final = 0.6  # of the episodes that are left; others confirm the front
CONFIRM_SHARE: Final = 0.25  # of all episodes, to confirm a front
FORMS_TO_AFFORD: Final = 16  # forms that can be compared in all worlds, at least
LEAST_EPISODES: Final = ceil(FIRST * FORMS_TO_AFFORD / SEARCH_SHARE)  # for a search


class Pruning(BaseModel, frozen=True, extra="forbid"):
    """Settings of the shortening of a run's best robot."""

    tolerance: float = Field(0.01, ge=0, le=0.5)
    """Largest loss of mean fitness, as a share of the mean size of the tree's fitness."""
    episodes: int = Field(800, ge=0, le=1_000_000)  # at most; 0: the tree stays as it is
    budget_share: float = Field(0.15, ge=0, le=0.5)  # of `budget.episodes`, at most
    worlds: int = Field(20, ge=FIRST, le=1000)  # in which a shorter form is compared, at most


@dataclass(frozen=True, slots=True)
class Keep:
    """What a shorter tree must keep: fitness, tiers, behaviours and constraints."""

    tolerance: float  # as in `Pruning`
    classes: Classes  # with the tiers and behaviours
    constraints: Constraints  # kept at least as well as the original does


@dataclass(frozen=True, slots=True)
class Standard:
    """The outcomes of the original tree in some worlds, with which others are compared."""

    outcomes: Sequence[Outcome]
    keep: Keep

    def differences(self, outcomes: Sequence[Outcome]) -> list[float]:
        """Points by world, from the first one on: a tree's fitness less that of the original."""
        pairs = zip(outcomes, self.outcomes, strict=False)
        return [mine.fitness - original.fitness for mine, original in pairs]

    @property
    def size(self) -> float:
        """The mean size of the fitness, points."""
        return fmean(abs(o.fitness) for o in self.outcomes)

    @property
    def allowed(self) -> float:
        """The largest loss of mean fitness, points."""
        return self.keep.tolerance * self.size

    def keeps(self, outcomes: Sequence[Outcome]) -> bool:
        """True if a tree with these outcomes can replace the original."""
        if fmean(self.differences(outcomes)) < -self.allowed or self._worse_in_kind(outcomes):
            return False
        return self._is_feasible(outcomes)

    def confirms(self, outcomes: Sequence[Outcome]) -> bool:
        """True if a tree that was chosen elsewhere has these outcomes in fresh worlds and is kept.

        It is unless its loss exceeds the tolerance by a standard error (the one-standard-error rule
        of Breiman et al. 1984, Classification and Regression Trees, 3.4.3), or it loses a tier, a
        behaviour or a constraint.
        """
        return not self.is_hopeless(outcomes) and self._is_feasible(outcomes)

    def _is_feasible(self, outcomes: Sequence[Outcome]) -> bool:
        """True if a tree with these outcomes violates constraints no more than the original."""
        limit = mean_violation(self.outcomes[: len(outcomes)], self.keep.constraints)
        return mean_violation(outcomes, self.keep.constraints) <= limit

    def is_hopeless(self, outcomes: Sequence[Outcome]) -> bool:
        """True if the loss in these worlds exceeds the tolerance by a standard error."""
        return self._loses(outcomes, self.allowed) or self._worse_in_kind(outcomes, 1)

    def is_ruined(self, outcomes: Sequence[Outcome]) -> bool:
        """True if the loss exceeds NEEDED by a standard error."""
        return self._loses(outcomes, NEEDED * self.size)

    def _loses(self, outcomes: Sequence[Outcome], points: float) -> bool:
        """True if the mean loss exceeds a number of points by a standard error."""
        differences = self.differences(outcomes)
        error = stdev(differences) / sqrt(len(differences)) if len(differences) > 1 else 0.0
        return fmean(differences) + error < -points

    def _worse_in_kind(self, outcomes: Sequence[Outcome], spare: int = 0) -> bool:
        """True if a tier or a behaviour is reached in too few of the worlds.

        `spare`: number of worlds in which it may be lost, whatever their share.
        """
        most = max(spare, int(LOST_SHARE * len(outcomes)))
        before = [self._kinds(o) for o in self.outcomes[: len(outcomes)]]
        after = [self._kinds(o) for o in outcomes]
        names = set().union(*before)
        return any(
            sum(name in kinds for kinds in before) - sum(name in kinds for kinds in after) > most
            for name in names
        )

    def _kinds(self, outcome: Outcome) -> frozenset[str]:
        """The tiers and behaviours of an episode."""
        shown = self.keep.classes.behaviours_of(outcome.counters)
        return frozenset(
            (*tiers(outcome, self.keep.classes), *(f"behaviour {name}" for name in shown))
        )


@dataclass(frozen=True, slots=True)
class Shortened:
    """A tree of the front, with the change that led to it."""

    tree: Node
    change: str  # from the tree before; "" for the first
    difference: float  # points, mean difference to the original in the worlds of the search


_Change: TypeAlias = tuple[tuple[str, ...], str, int]
"""Where a change is, the change in words, and its number among those with the same words there."""


@dataclass
class Shortening:
    """A tree that becomes shorter in a sequence of worlds; each episode is run once and counted."""

    standard: Standard  # the original's outcomes in all worlds
    evaluate: Evaluate
    run: Run  # runs an observed episode
    vocabulary: Vocabulary
    worlds: Sequence[int]
    episodes: int  # at most
    spent: int
    known: dict[Node, list[Outcome]]
    front: list[Shortened] = field(default_factory=list)
    """Each tree is shorter than the one before, or has a plainer condition."""
    last: Sequence[Outcome] = ()  # those of the last tree of the front, in all worlds
    ruinous: set[_Change] = field(default_factory=set)  # changes that lose NEEDED

    def shorten(self, tree: Node) -> None:
        """Shortens a tree step by step, while there are episodes."""
        self.front = [Shortened(tree, "", 0.0)]
        self.last = self.outcomes([tree], len(self.worlds))[0]
        self._without_rare_nodes()
        freed = partial(freed_forms, vocabulary=self.vocabulary)
        for forms in (shorter_forms, freed, rounded_forms):
            while self._pass(forms):
                pass  # a change may allow others that were rejected before

    def outcomes(self, trees: Sequence[Node], worlds: int) -> list[list[Outcome]]:
        """The outcomes of each tree in the first worlds."""
        for have in range(worlds):
            group = [tree for tree in trees if len(self.known.get(tree, ())) == have]
            if group:
                new = self.evaluate(group, self.worlds[have:worlds])
                self.spent += len(group) * (worlds - have)
                for tree, outcomes in zip(group, new, strict=True):
                    self.known[tree] = [*self.known.get(tree, ()), *outcomes]
        return [self.known[tree][:worlds] for tree in trees]

    def affords(self, trees: int) -> bool:
        """True if the first worlds of some trees and all worlds of one are within the budget."""
        return self.spent + trees * FIRST + len(self.worlds) <= self.episodes

    def _accept(self, tree: Node, change: str, outcomes: Sequence[Outcome]) -> None:
        mean = fmean(self.standard.differences(outcomes))
        self.front.append(Shortened(tree, change, mean))
        self.last = outcomes

    def _without_rare_nodes(self) -> None:
        """Removes the nodes that run least, many at once while that holds."""
        tree, observed = self.front[0].tree, self.worlds[:OBSERVED]
        ticks = [node.ticks for node in usage(self.run, tree, observed)]
        self.spent += len(observed)
        order = sorted(removable(tree), key=ticks.__getitem__)
        gone, start, many = frozenset[int](), 0, max(1, len(order) // 2)
        while start < len(order) and self.affords(1):
            more = gone.union(order[start : start + many])
            form = without(tree, more)
            shorter = form and simplify(form, self.vocabulary).tree
            outcomes = shorter and self._kept_outcomes(shorter)
            if shorter and outcomes:
                if shorter != self.front[-1].tree:
                    self._accept(shorter, removal(tree, more - gone), outcomes)
                gone, start = more, start + many
            elif many == 1:
                start += 1
            else:
                many //= 2

    def _pass(self, forms: Callable[[Node], list[ShorterForm]]) -> bool:
        """Tries each form of the last tree once; the front gets those that keep the standard.

        Returns:
            True if there was one.
        """
        rejected, before = set(self.ruinous), len(self.front)
        while (form := self._first_kept(forms(self.front[-1].tree), rejected)) is not None:
            self._accept(simplify(form.tree, self.vocabulary).tree, form.change, self.last)
        return len(self.front) > before

    def _first_kept(self, forms: list[ShorterForm], rejected: set[_Change]) -> ShorterForm | None:
        """The first form that keeps the standard, whose outcomes are then `last`.

        None: there is none, or no budget. Forms that do not are added to `rejected`.
        """
        untried = [pair for pair in _numbered(forms) if pair[0] not in rejected]
        for start in range(0, len(untried), BATCH):
            batch = untried[start : start + BATCH]
            if not self.affords(len(batch)):
                return None
            self.outcomes([form.tree for _, form in batch], FIRST)
            for change, form in batch:
                if not self.affords(0):
                    return None
                outcomes = self._kept_outcomes(form.tree)
                if outcomes is not None and self._is_new(form):
                    self.last = outcomes
                    return form
                if self.standard.is_ruined(self.known[form.tree]):
                    self.ruinous.add(change)
                rejected.add(change)
        return None

    def _is_new(self, form: ShorterForm) -> bool:
        """False if simplified the form is a tree of the front: it would be tried for ever."""
        tree = simplify(form.tree, self.vocabulary).tree
        return all(tree != each.tree for each in self.front)

    def _kept_outcomes(self, tree: Node) -> Sequence[Outcome] | None:
        """The outcomes of a tree in all worlds if it keeps the standard, else None.

        A tree that loses clearly in few worlds is not tried in more; nor is one whose outcomes
        equal those of the last tree of the front in twice FIRST worlds, as it probably behaves as
        that one.
        """
        standard, everywhere = self.standard, len(self.worlds)
        for worlds in (FIRST, 2 * FIRST):
            if worlds < everywhere:
                outcomes = self.outcomes([tree], worlds)[0]
                if standard.is_hopeless(outcomes):
                    return None
                if worlds > FIRST and outcomes == list(self.last[:worlds]):
                    return self.last
        outcomes = self.outcomes([tree], everywhere)[0]
        return outcomes if standard.keeps(outcomes) else None


def _numbered(forms: Iterable[ShorterForm]) -> Iterator[tuple[_Change, ShorterForm]]:
    """The forms with a key that stays the same when another part of the tree changes."""
    seen: Counter[tuple[tuple[str, ...], str]] = Counter()
    for form in forms:
        key = form.above, form.change
        yield (*key, seen[key]), form
        seen[key] += 1


def thinned(front: Sequence[Shortened], most: int) -> list[Shortened]:
    """At most `most` trees of a front, with different numbers of nodes, always the shortest one.

    Of trees with equal numbers of nodes, the last one is kept.
    """
    by_size = {size(step.tree): step for step in front}
    steps = [by_size[nodes] for nodes in sorted(by_size)]
    if len(steps) <= most:
        return steps
    if most == 1:
        return steps[:1]
    return [steps[i * (len(steps) - 1) // (most - 1)] for i in range(most)]


@dataclass(frozen=True, slots=True)
class Confirmed:
    """A tree of the front in fresh worlds."""

    tree: Node
    differences: tuple[float, ...]  # points by world, to the original in the same world
    kept: bool  # True: it keeps the standard of the original


@dataclass(frozen=True, slots=True)
class PruneResult:
    """The result of `prune`."""

    original: Node
    steps: tuple[Shortened, ...]  # from the simplified original to the best tree
    front: tuple[Confirmed, ...]  # the trees tried in fresh worlds, the shortest first
    episodes: int  # that were spent
    earns_nothing: bool  # True: the original has 0 points in all worlds, as many other trees do

    @property
    def best(self) -> Node:
        """The shortest tree that keeps the standard in fresh worlds."""
        return self.steps[-1].tree


def prune(
    tree: Node,
    vocabulary: Vocabulary,
    evaluate: Evaluate,
    run: Run,
    worlds: Callable[[int], Sequence[int]],
    keep: Keep,
    *,
    episodes: int,
    most_worlds: int,
) -> PruneResult:
    """Shortens a tree and confirms the result in fresh worlds.

    A form that holds by luck in the worlds of a search spoils the trees after it. So further
    searches, in other worlds, start with the shortest tree that was confirmed.

    Args:
        tree: the original.
        vocabulary: of its domain.
        evaluate: runs episodes.
        run: runs an observed episode.
        worlds: returns that number of fresh world seeds at each call.
        keep: what a shorter tree must keep.
        episodes: at most.
        most_worlds: in which a shorter form is compared.

    Returns:
        The steps and the front. With too few episodes for a search, the original is the only step.
    """
    simple = simplify(tree, vocabulary).tree
    steps, front, spent, earns_nothing = [Shortened(simple, "", 0.0)], list[Confirmed](), 0, False
    while not earns_nothing:
        search = int(SEARCH_SHARE * (episodes - spent))
        count = min(most_worlds, search // FORMS_TO_AFFORD)
        if count < FIRST:
            break
        seeds = worlds(count)
        (reference,) = evaluate([simple], seeds)
        earns_nothing = not any(outcome.fitness for outcome in reference)
        standard, known = Standard(reference, keep), {simple: reference}
        bench = Shortening(standard, evaluate, run, vocabulary, seeds, search, count, known)
        if not earns_nothing:
            bench.shorten(steps[-1].tree)
        new = bench.front
        spent += bench.spent
        trees = [step.tree for step in thinned(new[1:], FRONT)]
        if not trees:
            break
        left = min(episodes - spent, int(CONFIRM_SHARE * episodes))
        fresh = worlds(max(1, left // (len(trees) + 1)))
        reference, *others = evaluate([simple, *trees], fresh)
        standard = Standard(reference, keep)
        confirmed = [
            Confirmed(tree, tuple(standard.differences(own)), standard.confirms(own))
            for tree, own in zip(trees, others, strict=True)
        ]
        spent += len(fresh) * (len(trees) + 1)
        front += confirmed
        kept = [each.tree for each in confirmed if each.kept]
        if kept:
            steps += new[1 : [step.tree for step in new].index(kept[0]) + 1]
    by_size = {size(each.tree): each for each in sorted(front, key=lambda each: each.kept)}
    return PruneResult(
        tree,
        tuple(steps if front else [Shortened(tree, "", 0.0)]),
        tuple(by_size[nodes] for nodes in sorted(by_size)),
        spent,
        earns_nothing,
    )
