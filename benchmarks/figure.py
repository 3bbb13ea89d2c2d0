"""The nouns: a figure, its goal, and what one benchmark gives."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal


class Effort(IntEnum):
    """How long a benchmark may take."""

    TINY = 0  # for tests: the figures mean nothing
    QUICK = 1  # a first look
    FULL = 2  # what is written down


@dataclass(frozen=True, slots=True)
class Goal:
    """What a figure should be."""

    side: Literal["at most", "at least"]
    value: float  # in the figure's unit

    def reached(self, value: float) -> bool:
        """Whether a value is good enough."""
        return value <= self.value if self.side == "at most" else value >= self.value


@dataclass(frozen=True, slots=True)
class Figure:
    """One number, and what people need in order to read it."""

    name: str  # unique among all benchmarks
    value: float
    unit: str  # "" for a plain ratio, "%" for a share in percent
    what: str  # one line
    goal: Goal | None = None
    warning: str = ""  # what is odd about this value


class Missing(Exception):
    """A benchmark can't run here; the message names what is missing."""


def at_most(value: float) -> Goal:
    """Less is better."""
    return Goal("at most", value)


def at_least(value: float) -> Goal:
    """More is better."""
    return Goal("at least", value)
