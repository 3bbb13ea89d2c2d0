"""The paper's search: Algorithm 1 with the slots of Table 1 (sections 2.3 and 2.4.3)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final

from pydantic import BaseModel

from islandgp.gp.allocation import next_population, update_behaviour_archive
from islandgp.gp.plan import Allocation, Plan
from islandgp.gp.population import Advice, BehaviourBest, Evaluated, Individual, Origin
from islandgp.gp.random_trees import random_tree
from islandgp.gp.variation import mutate
from islandgp.scoring.generation_stats import diversity
from islandgp.search.base import SearchContext, SearchState
from islandgp.seeding import Stream, Streams

UNMUTATED: Final = (Origin.ELITE, Origin.BEHAVIOURAL_ELITE, Origin.INJECTED)
"""Origins of individuals that are not mutated if `gp.mutate_elites` is false."""


@dataclass(frozen=True, slots=True)
class Parents:
    """The last generation and the best individual of each behaviour."""

    population: tuple[Evaluated, ...]
    archive: dict[str, BehaviourBest] = field(default_factory=dict)
    """The best individual of each behaviour, which is resurrected if the behaviour dies out."""


class PaperSettings(BaseModel, frozen=True, extra="forbid"):
    """None of its own."""

    @property
    def reads(self) -> tuple[str, ...]:
        """See `Search`."""
        variation = ("selection", "tournament_size", "crossover", "crossover_rate", "mutation")
        others = ("mutation_rate", "mutate_elites", "trees")
        return tuple(f"gp.{name}" for name in (*variation, *others))


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
            return first_population(self.plan, streams)
        parents: Parents = state.memory
        advice = state.advice or Advice(self.plan.gp.mutation_rate)
        population = next_population(
            self.plan,
            parents.population,
            streams=streams,
            generation=state.generation,
            injected=advice.tree,
            edited=advice.edited,
            archive=parents.archive,
            diversity=diversity([e.labels.specialist for e in parents.population]),
        )
        return mutated(self.plan, population, streams, state.generation, advice.rate)

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


def first_population(plan: Plan, streams: Streams) -> Iterator[Individual]:
    """Yields the plan's founders, then random trees, each drawn from the stream of its slot."""
    founders = plan.founders[: plan.gp.population]
    for slot, tree in enumerate(founders):
        yield Individual(f"0.{slot}", tree, Origin.INJECTED)
    for slot in range(len(founders), plan.gp.population):
        tree = random_tree(streams(Stream.INITIAL, slot=slot), plan.space)
        yield Individual(f"0.{slot}", tree, Origin.RANDOM)


def mutated(
    plan: Plan, population: Iterable[Individual], streams: Streams, generation: int, rate: float
) -> Iterator[Individual]:
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
