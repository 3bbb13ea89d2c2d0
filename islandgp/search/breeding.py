"""Random trees, children, and the order of slots, for searches with `search.policy.breeding`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Final, Generic, Self, TypeVar

from pydantic import BaseModel, Field, model_validator

from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.node import Node, within
from islandgp.gp.branches import random_list
from islandgp.gp.evidence import Evidence, digest, with_evaluation
from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual, Origin, Proposal, Tree, in_slots
from islandgp.gp.random_trees import TreeSpace, random_tree, weighted, weights_of
from islandgp.gp.selection import by_rank
from islandgp.gp.variation import CROSSOVERS, MutationSettings, crossover, mutate
from islandgp.search.base import SearchContext, SearchState
from islandgp.seeding import Rng, Stream, Streams

TRIES: Final = 30  # attempts to create a tree that was not evaluated before
CROSSED_ONLY: Final = 0.7  # chance that a child of two parents is not mutated as well


class RandomTrees(BaseModel, frozen=True, extra="forbid"):
    """Settings of random trees; `gp.trees` has those of the paper's."""

    lists: float = Field(ge=0, le=1)
    """Share of priority lists among random trees; the others are the paper's random trees."""
    simplify: bool  # parts of new trees that provably have no effect are removed


class Breeding(RandomTrees, frozen=True, extra="forbid"):
    """Settings of new trees."""

    crossover_rate: float = Field(ge=0, le=1)  # share of children with two parents
    crossovers: Annotated[dict[str, float], weights_of(CROSSOVERS, crossover)]
    """Weight of each of CROSSOVERS, or of a "module:function"."""
    mutation: MutationSettings
    further: float = Field(ge=0, lt=1)
    """Probability of another mutation of the same child, after each mutation."""


MAX_DIGESTS: Final = 3000  # most digests of evaluated trees kept by a search, the latest ones


def new_tree(rng: Rng, space: TreeSpace, settings: RandomTrees) -> Node:
    """A random tree: a priority list with probability `settings.lists`, else as in the paper.

    After TRIES trees that exceed the limits it is one as in the paper, without simplification.
    """
    for _ in range(TRIES):
        lists = rng.random() < settings.lists
        tree = random_list(rng, space) if lists else random_tree(rng, space)
        if settings.simplify:
            tree = simplify(tree, space.vocabulary).tree
        if within(tree, space.limits):
            return tree
    return random_tree(rng, space)


@dataclass(frozen=True, slots=True)
class Parent:
    """A tree that can be a parent."""

    id: str  # of the individual; "" for a tree of the library
    tree: Tree


def parent_of(e: Evaluated) -> Parent:
    """An evaluated individual as a parent."""
    return Parent(e.individual.id, e.individual.tree)


Pick = Callable[[Rng], tuple[Parent, Sequence[Parent]]]
"""Draws a child's mother, and returns the candidates for its father."""


def pick_by_rank(ranked: Sequence[Parent], entrants: int = 2) -> Pick:
    """Tournament selection of mother and father: the first in `ranked` of `entrants` draws."""
    return lambda rng: (by_rank(rng, ranked, entrants), [by_rank(rng, ranked, entrants)])


def new_child(
    rng: Rng, mother: Parent, fathers: Sequence[Parent], space: TreeSpace, breeding: Breeding
) -> Proposal:
    """A child of `mother`, and possibly of one of `fathers`, within the limits.

    Args:
        rng: the generator is consumed.
        mother: its tree is changed.
        fathers: candidates for the second parent of a crossover; may be empty.
        space: actions, keys, limits and settings of random trees.
        breeding: the operators and their probabilities.

    Returns:
        The child. That of a mother and a branch of the library has the origin CROSSOVER and one
        parent.
    """
    tree, parents, origin = mother.tree, [mother.id], Origin.COPY
    if fathers and rng.random() < breeding.crossover_rate:
        father = fathers[int(rng.integers(len(fathers)))]
        cross = crossover(weighted(rng, breeding.crossovers))
        crossed = space.repaired(cross(rng, tree, father.tree, space.limits))
        if crossed != tree:
            tree, origin = crossed, Origin.CROSSOVER
            parents += [father.id] if father.id else []
    changes: list[str] = []
    more = origin is Origin.COPY or rng.random() >= CROSSED_ONLY
    while more:
        tree, change = mutate(rng, tree, rate=1.0, space=space, settings=breeding.mutation)
        changes.append(change)
        more = rng.random() < breeding.further
    if breeding.simplify:
        tree = simplify(tree, space.vocabulary).tree
    mutation = "+".join(change for change in changes if change)
    return Proposal(tree, origin, tuple(parents), mutation)


class NewSlots(BaseModel, frozen=True, extra="forbid"):
    """Slots of a generation besides those of trees evaluated again; children fill the rest."""

    random: float = Field(default=0, ge=0, lt=1)  # share of new random trees
    injected: int = Field(default=1, ge=1)  # of the supervisor's tree: itself, then mutants of it


class Slots(NewSlots, frozen=True, extra="forbid"):
    """The slots of a generation."""

    reevaluated: float = Field(ge=0, lt=1)  # share of trees that are evaluated again

    @model_validator(mode="after")
    def _children(self) -> Slots:
        if self.reevaluated + self.random >= 1:
            raise ValueError(
                "expected reevaluated + random below 1, so that there are children, found"
                f" {self.reevaluated:g} + {self.random:g}; lower one of them"
            )
        return self


@dataclass(frozen=True, slots=True)
class GenerationPlan:
    """The trees of a generation, except for a supervisor's."""

    pick: Pick | None = None  # draws the parents of children; None: random trees, no children
    propose: Callable[[Rng], Proposal | None] | None = None
    """Makes a new tree in another way; without it, or if it returns None: a child or random."""
    reevaluated: Sequence[Parent] = ()  # evaluated again, the most important first
    initial_trees: Sequence[Node] = ()  # evaluated unchanged, such as the founders of generation 0
    known_digests: Iterable[str] = ()  # of evaluated trees, which new trees should not repeat


def new_generation(
    plan: Plan,
    streams: Streams,
    state: SearchState,
    contents: GenerationPlan,
    settings: RandomTrees,
) -> Iterator[Proposal]:
    """Yields the trees of a generation, `gp.population` of them, in slot order.

    The order: initial trees, trees evaluated again, the supervisor's tree, edited trees, new trees:
    mutants of the supervisor's tree, random trees, children. Trees evaluated again leave at least
    two slots to the others.

    Args:
        plan: with the number of individuals and the space of trees.
        streams: the run's random streams; those of new slots are consumed.
        state: has the generation's index and the supervisor's advice for it.
        contents: the contents of the generation.
        settings: of random trees, and of children (a Breeding) if `contents` has parents.
    """
    g, n = state.generation, plan.gp.population
    advice = state.advice or Advice(rate=0.0)
    again = contents.reevaluated[: n - 2 - len(advice.edited)]
    first_slots = [
        *(Proposal(tree, Origin.INJECTED) for tree in contents.initial_trees[:n]),
        *(Proposal(p.tree, Origin.ELITE, (p.id,)) for p in again),
        *([Proposal(advice.tree, Origin.INJECTED)] if advice.tree is not None else ()),
        *advice.edited,
    ]
    yield from first_slots
    known_digests = {*contents.known_digests, *(digest(each.tree) for each in first_slots)}
    slots = plan.allocation if isinstance(plan.allocation, NewSlots) else NewSlots()
    new = [contents] * (n - len(first_slots))
    new[:0] = [GenerationPlan()] * round(slots.random * n)
    if advice.tree is not None:
        mutants = GenerationPlan(propose=_mutants(advice.tree, plan.space, settings))
        new[:0] = [mutants] * (slots.injected - 1)
    for slot, each in zip(range(len(first_slots), n), new, strict=False):
        rng = streams(Stream.SEARCH, generation=g, slot=slot)
        for _ in range(TRIES):  # after these, a tree that was evaluated before is accepted
            proposal = _proposed(rng, each, plan.space, settings)
            key = digest(proposal.tree)
            if key not in known_digests:
                break
        known_digests.add(key)
        yield proposal


def _mutants(tree: Node, space: TreeSpace, settings: RandomTrees) -> Callable[[Rng], Proposal]:
    """A function that makes mutants of the supervisor's tree."""
    assert isinstance(settings, Breeding)

    def propose(rng: Rng) -> Proposal:
        mutant = new_child(rng, Parent("", tree), (), space, settings)
        return Proposal(mutant.tree, Origin.INJECTED, mutation=mutant.mutation)

    return propose


def _proposed(
    rng: Rng, contents: GenerationPlan, space: TreeSpace, settings: RandomTrees
) -> Proposal:
    """A proposed tree, a child of the parents that `contents.pick` draws, or a random tree."""
    if contents.propose is not None and (proposal := contents.propose(rng)) is not None:
        return proposal
    if contents.pick is None:
        return Proposal(new_tree(rng, space, settings), Origin.RANDOM)
    assert isinstance(settings, Breeding)
    return new_child(rng, *contents.pick(rng), space, settings)


def evidence_by_digest(
    before: Iterable[Evidence],
    evaluated: Iterable[Evaluated],
    generation: int,
    values: Callable[[Evaluated], Mapping[str, float]],
) -> dict[str, Evidence]:
    """The evidence of trees, by digest, after a generation.

    Args:
        before: the evidence so far.
        evaluated: the generation.
        generation: its index.
        values: returns the values of an evaluation whose means are kept.
    """
    by_digest = {entry.digest: entry for entry in before}
    for e in evaluated:
        key = digest(e.individual.tree)
        by_digest[key] = with_evaluation(by_digest.get(key), e, generation, values(e))
    return by_digest


class BreedingSettings(BaseModel, frozen=True, extra="forbid"):
    """Settings of a search that creates children."""

    breeding: Breeding

    @property
    def reads(self) -> tuple[str, ...]:
        """See `Search`."""
        return ("gp.trees",)


S = TypeVar("S", bound=Any)


@dataclass(frozen=True, slots=True)
class LastGeneration:
    """The memory of a search that learns from the last generation alone."""

    population: tuple[Evaluated, ...]  # in slot order


class BreedingSearch(ABC, Generic[S]):
    """A search whose generations consist of re-evaluated trees, a supervisor's trees, and children.

    A subclass has `Settings`, mostly a subclass of BreedingSettings, and the method `plan_next`.
    One that remembers more than the last generation has the type `Memory` and `update`, too.
    """

    Memory: ClassVar[Any] = LastGeneration
    uses: ClassVar[frozenset[str]] = frozenset({"tree", "edits"})

    @classmethod
    def make(cls, settings: S, context: SearchContext) -> Self:
        """See `Search`."""
        return cls(settings, context.plan)

    def __init__(self, settings: S, plan: Plan) -> None:
        self.settings = settings
        self.plan = plan

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> Iterator[Individual]:
        """See `Search`."""
        contents = self.plan_first(streams) if state.memory is None else self.plan_next(state)
        proposals = new_generation(self.plan, streams, state, contents, self.settings.breeding)
        return in_slots(proposals, state.generation)

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """See `Search`."""
        memory = self.update(state, evaluated)
        return SearchState(state.generation + 1, memory, advice if self.uses else None)

    def plan_first(self, streams: Streams) -> GenerationPlan:  # noqa: ARG002 -- a subclass may draw
        """Generation 0: the plan's founders, then random trees."""
        return GenerationPlan(initial_trees=self.plan.founders)

    @abstractmethod
    def plan_next(self, state: SearchState) -> GenerationPlan:
        """The trees of a later generation, from the memory in `state`."""

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> Any:  # noqa: ARG002 -- a subclass may need it
        """The memory after a generation; `state.memory` is None after the first generation."""
        return LastGeneration(tuple(evaluated))
