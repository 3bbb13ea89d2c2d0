"""Epsilon-lexicase selection over the terms of the fitness, or over episodes.

La Cava, Spector and Danai 2016, "Epsilon-Lexicase Selection for Regression" (GECCO); La Cava et al.
2019, Evolutionary Computation 27(3): the dynamic variant, whose epsilon is the median absolute
deviation of the individuals that are left. A parent has to be among the best in one case after
another, in an order that is drawn for each parent, so that specialists have children, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, Field

from islandgp.errors import ConfigError
from islandgp.gp.plan import Plan
from islandgp.gp.population import EditedTree, Evaluated, Individual, Tree
from islandgp.scoring.constraints import merit
from islandgp.search.base import Advice, SearchContext, SearchState
from islandgp.search.breeding import Breeding, Parent, first_generation, next_generation
from islandgp.seeding import Streams


class LexicaseSettings(BaseModel, frozen=True, extra="forbid"):
    """What individuals are selected by."""

    cases: Literal["components", "episodes"]  # terms of the fitness, or fitness in each episode
    elites: int = Field(ge=0)  # fittest of a generation that are evaluated again in the next one
    breeding: Breeding


@dataclass(frozen=True, slots=True)
class Contender:
    """An individual of the last generation."""

    parent: Parent
    fitness: float  # points
    cases: tuple[float, ...]  # points in each case
    violation: float = 0.0  # of the constraints, >= 0


@dataclass(frozen=True, slots=True)
class Contenders:
    """The last generation, in slot order."""

    all: tuple[Contender, ...]
    given: Tree | None  # of the supervisor, to inject
    edited: tuple[EditedTree, ...] = ()  # of the supervisor


class Lexicase:
    """See the module."""

    Settings = LexicaseSettings
    Memory: ClassVar[Any] = Contenders
    uses: ClassVar[frozenset[str]] = frozenset({"tree", "edits"})

    @classmethod
    def make(cls, settings: LexicaseSettings, context: SearchContext) -> Lexicase:
        """See `Search`. Raises ConfigError where there would be one case alone."""
        if settings.cases == "episodes" and context.plan.gp.episodes == 1:
            raise ConfigError(
                "search.policy.cases: expected several episodes an individual, found"
                " gp.episodes=1; raise it, or take components"
            )
        return cls(settings, context.plan)

    def __init__(self, settings: LexicaseSettings, plan: Plan) -> None:
        self.settings = settings
        self.plan = plan

    def start(self) -> SearchState:
        """See `Search`."""
        return SearchState(0)

    def ask(self, state: SearchState, streams: Streams) -> tuple[Individual, ...]:
        """See `Search`."""
        memory: Contenders | None = state.memory
        if memory is None:
            return first_generation(self.plan, streams, self.settings.breeding)
        parents = [c.parent for c in memory.all]
        points = np.array([c.cases for c in memory.all])
        merits = [merit(c.fitness, c.violation) for c in memory.all]
        fittest = sorted(range(len(parents)), key=lambda k: merits[k], reverse=True)
        entrants = eligible(np.array([c.violation for c in memory.all]))

        def pick(rng: np.random.Generator) -> tuple[Parent, Sequence[Parent]]:
            mother, father = (parents[selected(rng, points, entrants)] for _ in range(2))
            return mother, [father]

        return next_generation(
            self.plan,
            streams,
            state.generation,
            again=[parents[k] for k in fittest[: self.settings.elites]],
            tree=memory.given,
            edited=memory.edited,
            pick=pick,
            how=self.settings.breeding,
        )

    def tell(
        self, state: SearchState, evaluated: Sequence[Evaluated], advice: Advice
    ) -> SearchState:
        """See `Search`."""
        found = tuple(contender(e, self._cases(e)) for e in evaluated)
        return SearchState(state.generation + 1, Contenders(found, advice.tree, advice.edited))

    def _cases(self, e: Evaluated) -> tuple[float, ...]:
        if self.settings.cases == "episodes":
            return e.episodes
        return tuple(e.outcome.components.values())


def contender(e: Evaluated, cases: tuple[float, ...]) -> Contender:
    """An evaluated individual with its points in each case."""
    return Contender(Parent(e.individual.id, e.individual.tree), e.fitness, cases, e.violation)


def eligible(violations: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Indices of those who may be selected: who keeps all constraints.

    Where nobody does, the violation is the first case: those within epsilon of the smallest.
    """
    if not violations.min():
        return np.flatnonzero(violations == 0)
    epsilon = np.median(np.abs(violations - np.median(violations)))
    return np.flatnonzero(violations <= violations.min() + epsilon)


def selected(
    rng: np.random.Generator,
    points: np.ndarray[Any, Any],
    entrants: np.ndarray[Any, Any] | None = None,
) -> int:
    """The row that is selected, among all `entrants` that pass every case in a random order.

    `entrants` are indices of rows; None: all.
    """
    entrants = np.arange(len(points)) if entrants is None else entrants
    order = rng.permutation(points.shape[1]).tolist()
    left = entrants[passing(points[entrants], order)]
    return int(left[rng.integers(len(left))])


def passing(points: np.ndarray[Any, Any], order: Sequence[int]) -> np.ndarray[Any, Any]:
    """The rows that are within epsilon of the best of those left, in case after case.

    Args:
        points: of each individual (rows) in each case (columns); more is better.
        order: of the cases.

    Returns:
        Indices of rows, at least one.
    """
    left = np.arange(len(points))
    for case in order:
        if len(left) == 1:
            break
        values = points[left, case]
        epsilon = np.median(np.abs(values - np.median(values)))
        left = left[values >= values.max() - epsilon]
    return left
