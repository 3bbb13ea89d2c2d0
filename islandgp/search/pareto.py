"""Pareto fronts, crowding distances, constraints: Deb et al. 2002, sections III.A, III.B, VI."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np

Points = np.ndarray[Any, np.dtype[np.float64]]
"""A row for each individual, a column for each objective; more is better."""


def crowded_order(points: Points, violations: Sequence[float] | None = None) -> list[int]:
    """Rows by rank, and those of one rank by crowding distance, the least crowded first.

    Args:
        points: of at least one individual.
        violations: of constraints by each row, >= 0; None: there are none.
    """
    rank = ranks(points, violations)
    distance = np.zeros(len(points))
    for r in range(int(rank.max()) + 1):
        front = np.flatnonzero(rank == r)
        distance[front] = crowding(points[front])
    return sorted(range(len(points)), key=lambda k: (rank[k], -distance[k]))


def ranks(
    points: Points, violations: Sequence[float] | None = None
) -> np.ndarray[Any, np.dtype[np.int64]]:
    """The front of each row: 0 for those that no row dominates, 1 without these, and so on.

    A smaller violation dominates a larger one regardless of the points (section VI).
    """
    broken = np.zeros(len(points)) if violations is None else np.array(violations)

    def dominated(k: int) -> Any:
        better = (points[k] >= points).all(axis=1) & (points[k] > points).any(axis=1)
        return (broken[k] < broken) | ((broken[k] == broken) & better)

    by = np.zeros(len(points), dtype=np.int64)  # rows without a rank that dominate each row
    for k in range(len(points)):
        by += dominated(k)
    rank = np.full(len(points), -1)
    r = 0
    while len(front := np.flatnonzero((by == 0) & (rank < 0))):
        rank[front] = r
        for k in front.tolist():
            by -= dominated(k)
        r += 1
    return rank


def crowding(front: Points) -> Points:
    """The crowding distance of each row of one front; inf for those with an extreme value."""
    distance = np.zeros(len(front))
    for values in front.T:
        order = np.argsort(values, kind="stable")
        low, high = values[order[0]], values[order[-1]]
        distance[order[[0, -1]]] = inf
        if high > low:
            gaps = values[order[2:]] - values[order[:-2]]
            distance[order[1:-1]] += gaps / (high - low)
    return distance
