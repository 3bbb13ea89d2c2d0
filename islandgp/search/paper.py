"""The paper's search: Algorithm 1 with the slots of Table 1 (sections 2.3 and 2.4.3).

The slots are filled in this order: elites, behavioural elites, resurrected individuals, the
supervisor's tree, random trees (the diversity slots), and tournament children. Then they are
mutated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Final

from pydantic import BaseModel, Field, NonNegativeInt, model_validator

from islandgp.gp.plan import Plan
from islandgp.gp.population import Advice, Evaluated, Individual, Origin, Proposal, in_slots, ranked
from islandgp.gp.random_trees import random_tree
from islandgp.gp.selection import pick_parent, selection
from islandgp.gp.variation import crossover, mutate
from islandgp.plain import RISING
from islandgp.scoring.generation_stats import diversity
from islandgp.search.base import SearchContext, SearchState
from islandgp.seeding import Stream, Streams

BehaviourArchive = dict[str, tuple[int, Evaluated]]
"""The best individual of each behaviour, after the last stage of the curriculum that had it."""

UNMUTATED: Final = (Origin.ELITE, Origin.BEHAVIOURAL_ELITE, Origin.INJECTED)
"""Origins of individuals that are not mutated if `gp.mutate_elites` is false."""


@dataclass(frozen=True, slots=True)
class Parents:
    """The last generation and the best individual of each behaviour."""

    population: tuple[Evaluated, ...]
    archive: BehaviourArchive = field(default_factory=dict)
    """The best individual of each behaviour, which is resurrected if the behaviour dies out."""


class PaperSettings(BaseModel, frozen=True, extra="forbid"):
    """None of its own."""

    @property
    def reads(self) -> tuple[str, ...]:
        """See `Search`."""
        variation = ("selection", "tournament_size", "crossover", "crossover_rate", "mutation")
        others = ("mutation_rate", "mutate_elites", "trees")
        return tuple(f"gp.{name}" for name in (*variation, *others))


class Allocation(BaseModel, frozen=True, extra="forbid"):
    """Table 1. Counts are for `per` individuals and scale with the population."""

    per: int = Field(ge=1)
    elites: int = Field(ge=0)  # at most
    behavioural_elites: int = Field(ge=0)  # at most
    resurrected: int = Field(ge=0)  # at most
    diversity: Annotated[tuple[Annotated[int, Field(ge=1)], int], RISING]  # least and most
    tournament_children: Annotated[tuple[NonNegativeInt, int], RISING]
    """Least and most; none: a random search."""
    diversity_targets: tuple[
        float, float
    ]  # Eq. (3): from the first on, the fewest slots; below the second, the most
    niche_share: float = Field(gt=0, le=1)  # a class gives at most this share of the parents

    @model_validator(mode="after")
    def _ranges(self) -> Allocation:
        enough, low = self.diversity_targets
        if not 0 <= low <= enough <= 1:
            raise ValueError(
                f"diversity_targets: expected 1 >= first >= second >= 0, found [{enough}, {low}]"
            )
        reserved = self.elites + self.behavioural_elites + self.resurrected + self.diversity[0]
        if reserved + self.tournament_children[0] > self.per:
            raise ValueError(
                f"expected slots that fit into {self.per} individuals, found"
                f" {reserved} and at least {self.tournament_children[0]} tournament children"
            )
        return self


class Paper:
    """Elites, behavioural elites, resurrection, random trees and tournament children (Table 1).

    Its settings are those of the groups `gp` and `allocation`.
    """

    Settings = PaperSettings
    Allocation = Allocation
    Memory: ClassVar[Any] = Parents
    uses: ClassVar[frozenset[str]] = frozenset({"rate", "tree", "edits"})

    @classmethod
    def make(cls, settings: PaperSettings, context: SearchContext) -> Paper:  # noqa: ARG003 -- the protocol's
        """See `Search`."""
        return cls(context.plan)

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> Iterator[Individual]:
        """Line 2 of Algorithm 1 for generation 0, lines 8 to 15 for the others."""
        if state.memory is None:
            return in_slots(first_population(self.plan, streams), 0)
        parents: Parents = state.memory
        advice = state.advice or Advice(self.plan.gp.mutation_rate)
        population = next_population(self.plan, parents, streams, state.generation, advice)
        changed = mutated(self.plan, population, streams, state.generation, advice.rate)
        return in_slots(changed, state.generation)

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """See `Search`."""
        stage = self.plan.curriculum.stage(state.generation)
        before = {} if state.memory is None else state.memory.archive
        archive = update_behaviour_archive(
            before, evaluated, self.plan.classes.elite_behaviours, stage
        )
        return SearchState(state.generation + 1, Parents(tuple(evaluated), archive), advice)


def first_population(plan: Plan, streams: Streams) -> Iterator[Proposal]:
    """Yields the plan's founders, then random trees, each drawn from the stream of its slot."""
    founders = plan.founders[: plan.gp.population]
    for tree in founders:
        yield Proposal(tree, Origin.INJECTED)
    for slot in range(len(founders), plan.gp.population):
        tree = random_tree(streams(Stream.INITIAL, slot=slot), plan.space)
        yield Proposal(tree, Origin.RANDOM)


def update_behaviour_archive(
    archive: BehaviourArchive,
    population: Sequence[Evaluated],
    behaviours: Sequence[str],
    stage: int,
) -> BehaviourArchive:
    """The archive updated with the best individual of each behaviour in this generation.

    Stages of the curriculum have different scales, so an individual of a later stage replaces one
    of an earlier stage regardless of fitness.
    """
    updated = dict(archive)
    for e in population:
        for behaviour in e.labels.behaviours:
            best = updated.get(behaviour)
            if best is None or (stage, e.merit) > (best[0], best[1].merit):
                updated[behaviour] = stage, e
    return {name: updated[name] for name in behaviours if name in updated}


def scaled(count: int, allocation: Allocation, population: int) -> int:
    """A count of Table 1 scaled to the population size, rounded half up; at least 1 if it was."""
    return max(min(count, 1), (2 * count * population + allocation.per) // (2 * allocation.per))


def diversity_slots(
    allocation: Allocation, population: int, reserved: int, diversity: float
) -> int:
    """The number of diversity slots, within the ranges of Table 1: more if diversity is low."""
    fewest, most = (max(1, scaled(n, allocation, population)) for n in allocation.diversity)
    fewest_children, most_children = (
        scaled(n, allocation, population) for n in allocation.tournament_children
    )
    enough, low = allocation.diversity_targets
    middle = (fewest + most + 1) // 2
    slots = fewest if diversity >= enough else most if diversity < low else middle
    free = population - reserved
    slots = max(slots, min(most, free - most_children))
    return max(min(slots, free - fewest_children), min(fewest, free))


def elites(
    population: Sequence[Evaluated],
    allocation: Allocation,
    archive: BehaviourArchive,
    behaviours: Sequence[str],
) -> list[Proposal]:
    """The elites, behavioural elites and resurrected individuals of the next population."""
    n, order = len(population), ranked(tuple(population))
    best = order[: scaled(allocation.elites, allocation, n)]
    elite_ids = {e.individual.id for e in best}
    slots = [Proposal(e.individual.tree, Origin.ELITE, (e.individual.id,)) for e in best]
    room = scaled(allocation.behavioural_elites, allocation, n)
    for behaviour in behaviours:
        i = next((e.individual for e in order if behaviour in e.labels.behaviours), None)
        if room and i is not None and i.id not in elite_ids:
            elite_ids.add(i.id)
            room -= 1
            slots.append(Proposal(i.tree, Origin.BEHAVIOURAL_ELITE, (i.id,)))
    alive = {behaviour for e in population for behaviour in e.labels.behaviours}
    # An individual may be the best of several behaviours; it is resurrected once.
    lost = [e.individual for name, (_, e) in archive.items() if name not in alive]
    extinct = list({i.id: i for i in lost}.values())
    slots += [
        Proposal(a.tree, Origin.RESURRECTED, (a.id,))
        for a in extinct[: scaled(allocation.resurrected, allocation, n)]
    ]
    return slots


def next_population(
    plan: Plan, parents: Parents, streams: Streams, generation: int, advice: Advice
) -> Iterator[Proposal]:
    """Yields the population of `generation`, before mutation, of the same size as the last one.

    Edited trees replace tournament children.
    """
    population, edited = parents.population, advice.edited
    spread = diversity([e.labels.specialist for e in population])
    n, allocation = len(population), plan.allocation
    behaviours = plan.classes.elite_behaviours
    survivors = elites(population, allocation, parents.archive, behaviours)[: n - 2 - len(edited)]
    yield from survivors
    first = len(survivors)  # diversity slot
    end = first + diversity_slots(allocation, n, first + len(edited), spread)
    for slot in range(first, end):
        if slot == first and advice.tree is not None:
            yield Proposal(advice.tree, Origin.INJECTED)
            continue
        rng = streams(Stream.DIVERSITY, generation=generation, slot=slot)
        yield Proposal(random_tree(rng, plan.space), Origin.RANDOM)
    yield from edited
    yield from _children(plan, population, streams, generation, end + len(edited))


def _children(
    plan: Plan, population: Sequence[Evaluated], streams: Streams, generation: int, first: int
) -> Iterator[Proposal]:
    """Yields the tournament children in the slots from `first` on."""
    n, gp = len(population), plan.gp
    select, cross = selection(gp.selection), crossover(gp.crossover)
    supplied: Counter[str] = Counter()
    limit = plan.allocation.niche_share * (n - first) * (1 + gp.crossover_rate)
    for slot in range(first, n):
        rng = streams(Stream.SELECTION, generation=generation, slot=slot)
        parents = []
        for _ in range(2 if rng.random() < gp.crossover_rate else 1):
            e = pick_parent(
                rng, select, population, supplied, most=limit, entrants=gp.tournament_size
            )
            supplied[e.labels.specialist] += 1
            parents.append(e.individual)
        tree, origin = parents[0].tree, Origin.COPY
        if len(parents) > 1:
            rng = streams(Stream.CROSSOVER, generation=generation, slot=slot)
            crossed = cross(rng, tree, parents[1].tree, gp.limits)
            tree, origin = plan.space.repaired(crossed), Origin.CROSSOVER
        ids = tuple(parent.id for parent in parents)
        yield Proposal(tree, origin, ids)


def mutated(
    plan: Plan, population: Iterable[Proposal], streams: Streams, generation: int, rate: float
) -> Iterator[Proposal]:
    """Line 15: mutation of the constructed population; elites if `gp.mutate_elites` (2.4.3).

    Edited trees are evaluated unchanged.
    """
    for slot, i in enumerate(population):
        spared = () if plan.gp.mutate_elites else UNMUTATED
        if i.origin not in (*spared, Origin.EDITED):
            rng = streams(Stream.MUTATION, generation=generation, slot=slot)
            tree, operator = mutate(
                rng, i.tree, rate=rate, space=plan.space, settings=plan.gp.mutation
            )
            i = replace(i, tree=tree, mutation=operator)
        yield i
