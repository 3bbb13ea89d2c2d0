"""NSGA-II: multi-objective search by non-dominated sorting and crowding distance.

Deb, Pratap, Agarwal and Meyarivan 2002, "A fast and elitist multiobjective genetic algorithm:
NSGA-II", IEEE Transactions on Evolutionary Computation 6(2): fronts, crowding distances and
constraints as in sections III.A, III.B and VI. Survivors are evaluated again together with the
children, so all compared individuals have met the same worlds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

import numpy as np
from pydantic import Field

from islandgp.bt.core.node import size
from islandgp.domain import Schema
from islandgp.domain.rewards import unknown
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated
from islandgp.search.base import SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    BreedingSettings,
    GenerationPlan,
    Slots,
    parent_of,
    pick_by_rank,
)
from islandgp.search.descriptor import repeated

Points = np.ndarray[Any, np.dtype[np.float64]]
"""A row for each individual, a column for each objective; more is better."""


def crowded_order(points: Points, violations: Sequence[float] | None = None) -> list[int]:
    """Rows sorted by rank, then by crowding distance, the least crowded first.

    Args:
        points: of at least one individual.
        violations: of constraints by each row, >= 0; None: there are none.
    """
    rank = ranks(points, violations)
    distance = np.zeros(len(points))
    for r in range(int(rank.max()) + 1):
        front = np.flatnonzero(rank == r)
        distance[front] = crowding(points[front])
    keys = list(zip(rank.tolist(), (-distance).tolist(), strict=True))
    return sorted(range(len(points)), key=keys.__getitem__)


def ranks(
    points: Points, violations: Sequence[float] | None = None
) -> np.ndarray[Any, np.dtype[np.int64]]:
    """The front of each row: 0 for non-dominated rows, 1 for those dominated by front 0 only, etc.

    A smaller violation dominates a larger one regardless of the points (section VI).
    """
    excess = np.zeros(len(points)) if violations is None else np.array(violations)

    def dominators(rows: np.ndarray[Any, np.dtype[np.int64]]) -> Any:
        """The number of these rows that dominate each row."""
        numbers = np.zeros(len(points), dtype=np.int64)
        for own, own_excess in zip(points[rows], excess[rows], strict=True):
            better = (own >= points).all(axis=1) & (own > points).any(axis=1)
            numbers += (own_excess < excess) | ((own_excess == excess) & better)
        return numbers

    by = dominators(np.arange(len(points)))  # number of unranked rows that dominate each row
    rank = np.full(len(points), -1)
    r = 0
    while len(front := np.flatnonzero((by == 0) & (rank < 0))):
        rank[front] = r
        by -= dominators(front)
        r += 1
    return rank


def crowding(front: Points) -> Points:
    """The crowding distance of each row of a front; inf for rows with an extreme value."""
    distance = np.zeros(len(front))
    for values in front.T:
        order = np.argsort(values, kind="stable")
        low, high = values[order[0]], values[order[-1]]
        distance[order[[0, -1]]] = inf
        if high > low:
            gaps = values[order[2:]] - values[order[:-2]]
            distance[order[1:-1]] += gaps / (high - low)
    return distance


class ObjectiveSettings(BreedingSettings, frozen=True):
    """The objectives."""

    objectives: tuple[str, ...]
    """`fitness`, `nodes` and counters; a leading `-` minimises. Empty: the fitness and the
    behaviours' counters."""

    def faults(self, schema: Schema) -> Iterator[str]:
        """See `Search`."""
        measures = {"fitness": None, "nodes": None, **schema.counters}
        names = [text.removeprefix("-") for text in self.objectives]
        for k, name in enumerate(names):
            yield from unknown(f"search.policy.objectives.{k}", name, measures)
        yield from repeated("search.policy.objectives", names)


class SurvivorSlots(Slots, frozen=True, extra="forbid"):
    """The slots of a generation; the trees that are evaluated again are the parents."""

    reevaluated: float = Field(gt=0, lt=1)  # share of survivors, at least two


class NSGA2(BreedingSearch[ObjectiveSettings]):
    """The NSGA-II search; see the module."""

    Settings = ObjectiveSettings
    Allocation = SurvivorSlots

    def __init__(self, settings: ObjectiveSettings, plan: Plan) -> None:
        super().__init__(settings, plan)
        counters = dict.fromkeys(plan.classes.behaviours.values())
        self.objectives = settings.objectives or ("fitness", *counters)

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`. The parents are in the crowded-comparison order."""
        last: Sequence[Evaluated] = state.memory.population
        points = np.array([[_value(e, name) for name in self.objectives] for e in last])
        survivors = max(2, round(self.plan.allocation.reevaluated * len(last)))
        order = crowded_order(points, [e.violation for e in last])[:survivors]
        parents = [parent_of(last[k]) for k in order]
        return GenerationPlan(pick_by_rank(parents), reevaluated=parents)


def _value(e: Evaluated, objective: str) -> float:
    name = objective.removeprefix("-")
    value = float(size(e.individual.tree)) if name == "nodes" else e.outcome.measure(name)
    return -value if objective.startswith("-") else value
