"""Epsilon-lexicase selection over the terms of the fitness, or over episodes.

La Cava, Spector and Danai 2016, "Epsilon-Lexicase Selection for Regression" (GECCO); La Cava et al.
2019, Evolutionary Computation 27(3): the dynamic variant, whose epsilon is the median absolute
deviation of the remaining individuals. Cases are applied in an order that is drawn for each parent;
each case keeps the individuals near its best. So specialists have children, too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, Self

import numpy as np

from islandgp.errors import ConfigError
from islandgp.gp.population import Evaluated, ranked
from islandgp.search.base import SearchContext, SearchState
from islandgp.search.breeding import (
    BreedingSearch,
    BreedingSettings,
    GenerationPlan,
    Parent,
    Pick,
    Slots,
    parent_of,
)
from islandgp.seeding import Rng


class LexicaseSettings(BreedingSettings, frozen=True):
    """Criteria of the selection."""

    cases: Literal["components", "episodes"]  # terms of the fitness, or fitness in each episode


class Lexicase(BreedingSearch[LexicaseSettings]):
    """Epsilon-lexicase selection; see the module."""

    Settings = LexicaseSettings
    Allocation = Slots

    @classmethod
    def make(cls, settings: LexicaseSettings, context: SearchContext) -> Self:
        """See `Search`. Raises ConfigError if there is only one case."""
        if settings.cases == "episodes" and context.plan.gp.episodes == 1:
            raise ConfigError(
                "search.policy.cases: expected several episodes an individual, found"
                " gp.episodes=1; raise it, or take components"
            )
        return super().make(settings, context)

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`."""
        last: Sequence[Evaluated] = state.memory.population
        draw = lexicase_draw(last, [self.cases(e) for e in last])
        pick: Pick = lambda rng: (draw(rng), [draw(rng)])  # noqa: E731 -- typed by its name
        again = round(self.plan.allocation.reevaluated * self.plan.gp.population)
        return GenerationPlan(pick, reevaluated=[parent_of(e) for e in ranked(tuple(last))[:again]])

    def cases(self, e: Evaluated) -> tuple[float, ...]:
        """The points of an individual in each case."""
        by_episode = self.settings.cases == "episodes"
        return e.episodes if by_episode else tuple(e.outcome.components.values())


def lexicase_draw(
    population: Sequence[Evaluated], cases: Sequence[Sequence[float]]
) -> Callable[[Rng], Parent]:
    """A function that selects an individual, by its points in cases in a random order."""
    points = np.array(cases)
    entrants = eligible(np.array([e.violation for e in population]))
    return lambda rng: parent_of(population[selected(rng, points, entrants)])


def eligible(violations: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Indices of the individuals that can be selected: those that keep all constraints.

    If there are none, those whose violation is within epsilon of the smallest.
    """
    if not violations.min():
        return np.flatnonzero(violations == 0)
    epsilon = _deviation(violations)
    return np.flatnonzero(violations <= violations.min() + epsilon)


def selected(
    rng: Rng, points: np.ndarray[Any, Any], entrants: np.ndarray[Any, Any] | None = None
) -> int:
    """The selected row: one of the `entrants` that pass all cases in a random order.

    `entrants` are indices of rows; None: all.
    """
    entrants = np.arange(len(points)) if entrants is None else entrants
    order = rng.permutation(points.shape[1]).tolist()
    remaining = entrants[passing(points[entrants], order)]
    return int(remaining[rng.integers(len(remaining))])


def passing(points: np.ndarray[Any, Any], order: Sequence[int]) -> np.ndarray[Any, Any]:
    """The rows that pass all cases: within epsilon of the best remaining row in each.

    Args:
        points: of each individual (rows) in each case (columns); more is better.
        order: of the cases.

    Returns:
        Indices of rows, at least one.
    """
    remaining = np.arange(len(points))
    for case in order:
        if len(remaining) == 1:
            break
        values = points[remaining, case]
        epsilon = _deviation(values)
        remaining = remaining[values >= values.max() - epsilon]
    return remaining


def _deviation(values: np.ndarray[Any, Any]) -> float:
    """The median absolute deviation of finite values."""
    return float(np.median(np.abs(values - np.median(values))))
