"""Events of the island that can be worth points, and their log."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from islandgp.domains.island.vocabulary import SCHEMA

EVENTS: Final = tuple(SCHEMA.events)
(
    PICKUP, INTERACTION, CHARGE, SHUTDOWN, DELIVERY, EMPTY_DELIVERY, PATROL, DISCOVERY, IDLE,
    COLLISION, LEFTOVER,
) = range(len(EVENTS))  # fmt: skip
"""The events of `vocabulary` as numbers, for compiled functions."""

Award = Callable[[str, float], tuple[str, float]]
"""(event, amount) -> (component of the fitness, or "", points)."""


class IslandEventLog:
    """The events of an episode in order, and their total fitness."""

    __slots__ = ("award", "best", "best_step", "events", "fitness", "negative_since", "points")

    def __init__(self, award: Award) -> None:
        self.award = award
        self.events: list[tuple[int, str, float]] = []  # (step, event, amount)
        self.fitness = 0.0
        self.points: dict[str, float] = {}  # by component
        self.best = 0.0  # highest fitness so far
        self.best_step = 0  # step at which it was reached
        self.negative_since = -1  # step since which fitness is below 0, or -1

    def log(self, step: int, event: str, amount: float) -> None:
        """Records an event and adds its points."""
        self.events.append((step, event, float(amount)))
        component, points = self.award(event, amount)
        if component:
            self.points[component] = self.points.get(component, 0.0) + points
        self.fitness = fitness = self.fitness + points
        if fitness > self.best:
            self.best = fitness
            self.best_step = step
        if fitness >= 0:
            self.negative_since = -1
        elif self.negative_since < 0:
            self.negative_since = step
