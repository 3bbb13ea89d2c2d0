"""NSGA-II: several objectives at once.

Deb, Pratap, Agarwal and Meyarivan 2002, "A fast and elitist multiobjective genetic algorithm:
NSGA-II", IEEE Transactions on Evolutionary Computation 6(2). Survivors are evaluated again beside
the children, so that all individuals that are compared met the same worlds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, Field

from islandgp.bt.core.node import size
from islandgp.domain import Schema
from islandgp.gp.plan import Plan
from islandgp.gp.population import EditedTree, Evaluated, Individual, Tree
from islandgp.scoring.rewards import unknown
from islandgp.search.base import Advice, SearchContext, SearchState
from islandgp.search.breeding import Breeding, Parent, first_generation, next_generation
from islandgp.search.pareto import crowded_order
from islandgp.seeding import Streams


class Nsga2Settings(BaseModel, frozen=True, extra="forbid"):
    """What is maximised, and how many survive."""

    objectives: tuple[str, ...]
    """Of `fitness`, `nodes` and counters, after a `-` what is minimised; none: the fitness and the
    behaviours' counters."""
    survivors: float = Field(gt=0, lt=1)  # share of a generation
    breeding: Breeding

    def faults(self, schema: Schema) -> Iterator[str]:
        """See `Search`."""
        known = {"fitness": None, "nodes": None, **schema.counters}
        for k, text in enumerate(self.objectives):
            yield from unknown(f"search.policy.objectives.{k}", text.removeprefix("-"), known)


@dataclass(frozen=True, slots=True)
class Survivors:
    """Parents of the next generation, the first in the crowded-comparison order first."""

    parents: tuple[Parent, ...]
    given: Tree | None  # of the supervisor, to inject
    edited: tuple[EditedTree, ...] = ()  # of the supervisor


class Nsga2:
    """See the module."""

    Settings = Nsga2Settings
    Memory: ClassVar[Any] = Survivors
    uses: ClassVar[frozenset[str]] = frozenset({"tree", "edits"})

    @classmethod
    def make(cls, settings: Nsga2Settings, context: SearchContext) -> Nsga2:
        """See `Search`."""
        return cls(settings, context.plan)

    def __init__(self, settings: Nsga2Settings, plan: Plan) -> None:
        self.settings = settings
        self.plan = plan
        counters = dict.fromkeys(plan.classes.behaviours.values())
        self.objectives = settings.objectives or ("fitness", *counters)

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
        """See `Search`."""
        memory: Survivors | None = state.memory
        if memory is None:
            return first_generation(self.plan, streams, self.settings.breeding)
        parents = memory.parents

        def pick(rng: np.random.Generator) -> tuple[Parent, Sequence[Parent]]:
            mother, father = (parents[min(rng.integers(len(parents), size=2))] for _ in range(2))
            return mother, [father]

        return next_generation(
            self.plan,
            streams,
            state.generation,
            again=parents,
            tree=memory.given,
            edited=memory.edited,
            pick=pick,
            how=self.settings.breeding,
        )

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """See `Search`."""
        points = np.array([[_value(e, name) for name in self.objectives] for e in evaluated])
        broken = [e.violation for e in evaluated]
        most = max(2, round(self.settings.survivors * len(evaluated)))
        individuals = [evaluated[k].individual for k in crowded_order(points, broken)[:most]]
        parents = tuple(Parent(i.id, i.tree) for i in individuals)
        return SearchState(state.generation + 1, Survivors(parents, advice.tree, advice.edited))


def _value(e: Evaluated, objective: str) -> float:
    name = objective.removeprefix("-")
    value = float(size(e.individual.tree)) if name == "nodes" else e.outcome.measure(name)
    return -value if objective.startswith("-") else value
