"""Fitness: Table 3's rewards under Table 2's multipliers, Eq. (1) and (2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Annotated, Final

from pydantic import BaseModel, Field, FiniteFloat, model_validator

from islandgp.island.journal import Event


class Component(IntEnum):
    """The terms of Eq. (1); the first five have a multiplier in Table 2, the others 1."""

    GARBAGE = 0
    BATTERY = 1
    HUMANOID = 2
    DELIVERY = 3
    LEFTOVER = 4
    PATROL = 5
    IDLE = 6
    COLLISION = 7


class PerAction(BaseModel, frozen=True, extra="forbid"):
    """A reward with a base and a part for each item."""

    base: FiniteFloat
    per_item: FiniteFloat


class ChargeBand(BaseModel, frozen=True, extra="forbid"):
    """What a charging attempt earns below a battery level."""

    below: float = Field(gt=0, le=100)  # %
    points: FiniteFloat


class Rewards(BaseModel, frozen=True, extra="forbid"):
    """Table 3. Points; penalties are negative."""

    pickup: PerAction
    interaction: PerAction
    delivery: PerAction
    empty_delivery: FiniteFloat
    charge: tuple[ChargeBand, ...]  # by rising level
    charge_otherwise: FiniteFloat  # plus the battery level in percent
    shutdown: FiniteFloat
    patrol_segment: FiniteFloat
    discovery: FiniteFloat
    idle_second: FiniteFloat
    idle_grace: float = Field(ge=0)  # s of idleness that cost nothing
    collision: FiniteFloat
    leftover: FiniteFloat
    normalize: bool  # Eq. (2)
    maxima: tuple[FiniteFloat, ...]  # Eq. (2): largest values, in Component's order

    @model_validator(mode="after")
    def _complete(self) -> Rewards:
        if len(self.maxima) != len(Component) or min(self.maxima) <= 0:
            raise ValueError(f"maxima: expected {len(Component)} positive numbers, one a component")
        if list(self.charge) != sorted(self.charge, key=lambda band: band.below):
            raise ValueError("charge: expected bands by rising level")
        return self


Multiplier = Annotated[FiniteFloat, Field(ge=0)]


class Multipliers(BaseModel, frozen=True, extra="forbid"):
    """One row of Table 2."""

    garbage: Multiplier
    battery: Multiplier
    humanoid: Multiplier
    delivery: Multiplier
    leftover: Multiplier


def multiplier(stage: Multipliers, component: Component) -> float:
    """A component's multiplier in a stage: Table 2, and 1 where that has no column."""
    return float(getattr(stage, component.name.lower(), 1.0))


def charge_points(rewards: Rewards, battery: float) -> float:
    """Table 3's charging row: the emptier the battery (%), the more an attempt earns."""
    for band in rewards.charge:
        if battery < band.below:
            return band.points
    return rewards.charge_otherwise + battery


def _each(reward: PerAction, items: float) -> float:
    return reward.base + reward.per_item * items


def _idle(rewards: Rewards, seconds: float) -> float:
    return rewards.idle_second if seconds > rewards.idle_grace else 0.0


TABLE_3: Final[dict[Event, tuple[Component, Callable[[Rewards, float], float]]]] = {
    Event.PICKUP: (Component.GARBAGE, lambda r, n: _each(r.pickup, n)),
    Event.INTERACTION: (Component.HUMANOID, lambda r, n: _each(r.interaction, n)),
    Event.CHARGE: (Component.BATTERY, charge_points),
    Event.SHUTDOWN: (Component.BATTERY, lambda r, n: r.shutdown * n),
    Event.DELIVERY: (Component.DELIVERY, lambda r, n: _each(r.delivery, n)),
    Event.EMPTY_DELIVERY: (Component.DELIVERY, lambda r, n: r.empty_delivery * n),
    Event.PATROL: (Component.PATROL, lambda r, n: r.patrol_segment * n),
    Event.DISCOVERY: (Component.PATROL, lambda r, n: r.discovery * n),
    Event.IDLE: (Component.IDLE, _idle),
    Event.COLLISION: (Component.COLLISION, lambda r, n: r.collision * n),
    Event.LEFTOVER: (Component.LEFTOVER, lambda r, n: r.leftover * n),
}


def scales(rewards: Rewards, stage: Multipliers) -> tuple[float, ...]:
    """What the points of each component are multiplied with, in Component's order."""
    shares = rewards.maxima if rewards.normalize else None
    return tuple(multiplier(stage, c) / (shares[c] if shares else 1) for c in Component)


def award(rewards: Rewards, stage: Multipliers) -> Callable[[Event, float], float]:
    """What one event adds to the fitness in a stage, by its amount: a term of Eq. (1)."""
    scale = scales(rewards, stage)

    def worth(event: Event, amount: float) -> float:
        component, value = TABLE_3[event]
        return scale[component] * value(rewards, amount)

    return worth


def components(
    rewards: Rewards, stage: Multipliers, events: Sequence[tuple[int, Event, float]]
) -> tuple[float, ...]:
    """Fitness by component, in Component's order; the sum is Eq. (1)."""
    sums, worth = [0.0] * len(Component), award(rewards, stage)
    for _, event, amount in events:
        sums[TABLE_3[event][0]] += worth(event, amount)
    return tuple(sums)
