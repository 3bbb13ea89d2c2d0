"""The outcome of an episode. Not compiled, as instances of compiled classes cannot be pickled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from islandgp.domains.island.events import IslandEvent


class Ending(StrEnum):
    """Reason for the end of an episode."""

    TIME = "time"  # 420 s are over
    STAGNATION = "stagnation"  # no better fitness for 120 s (180 s with a low battery)
    NEGATIVE = "negative"  # fitness below zero for 60 s
    SHUTDOWN = "shutdown"  # the battery is empty


@dataclass(frozen=True, slots=True)
class Episode:
    """The outcome of an episode."""

    events: tuple[tuple[int, IslandEvent, float], ...]  # (step, event, amount), in order
    steps: int  # simulated steps, >= 1
    ending: Ending
    fitness: float  # points of all events
    points: Mapping[str, float]  # by component, of those that earned some
    battery: float  # % at the end
    distance: float  # m driven
    inactive: float  # s since the last non-movement action
    laps: int  # patrol rounds finished
    ticks: int  # how often the tree was ticked; a cost, not a result
