"""Specialist classes, labels and quality tiers: sections 2.3.3 and 2.3.4, Table 4.

The inequalities of section 2.3.3 did not survive in the paper's text. Here an
individual is a specialist when one count is more than `dominance_ratio` times
the other, and the four classes exclude each other; charging and clearing are
labels that any class can carry.
"""

from __future__ import annotations

from enum import StrEnum

from pydantic import BaseModel, Field, model_validator

from islandgp.scoring.outcome import Outcome


class Specialist(StrEnum):
    """The exclusive classes that diversity counts."""

    PATROL_ONLY = "patrol_only"  # no pickup and no interaction
    PICKUP = "pickup"  # far more pickups than interactions
    HUMANOID = "humanoid"  # far more interactions than pickups
    BALANCED = "balanced"  # both


class Tier(StrEnum):
    """The rows of Table 4; an individual may reach several."""

    EXCELLENT = "excellent"
    COMPLETE = "complete"
    FULL_SERVICE = "full_service"
    BALANCED_ELITE = "balanced_elite"


class Threshold(BaseModel, frozen=True, extra="forbid"):
    """One row of Table 4: least values; `above` ones must be exceeded."""

    pickups: float = Field(default=0, ge=0)
    interactions: float = Field(default=0, ge=0)
    deliveries: float = Field(default=0, ge=0)
    charges: float = Field(default=0, ge=0)
    gathered: float = Field(default=0, ge=0)
    gathered_above: float = Field(default=-1)
    fitness_above: float | None = None


class Classes(BaseModel, frozen=True, extra="forbid"):
    """How individuals are classified."""

    dominance_ratio: float = Field(ge=1)
    tiers: dict[Tier, Threshold]
    excellent_is_complete: bool  # section 2.3.4: an Excellent Robot is a Complete Robot first

    @model_validator(mode="after")
    def _complete(self) -> Classes:
        if missing := [tier.value for tier in Tier if tier not in self.tiers]:
            raise ValueError(
                f"tiers: expected a threshold for each tier, missing {', '.join(missing)}"
            )
        return self


def specialist(o: Outcome, classes: Classes) -> Specialist:
    """The one class of an individual (section 2.3.3)."""
    if o.pickups == 0 and o.interactions == 0:
        return Specialist.PATROL_ONLY
    if o.pickups > classes.dominance_ratio * o.interactions:
        return Specialist.PICKUP
    if o.interactions > classes.dominance_ratio * o.pickups:
        return Specialist.HUMANOID
    return Specialist.BALANCED


def is_charging(o: Outcome) -> bool:
    """The label Charging Robot: at least one charging attempt, in whichever of its episodes."""
    return o.charges > 0


def is_clearing(o: Outcome) -> bool:
    """The label Clearing Robot: at least one delivery."""
    return o.deliveries > 0


def is_working(o: Outcome) -> bool:
    """Whether it counts for the working ratio, Eq. (4): a pickup or an interaction."""
    return o.pickups > 0 or o.interactions > 0


def reaches(o: Outcome, threshold: Threshold) -> bool:
    """Whether an outcome meets a row of Table 4."""
    return (
        o.pickups >= threshold.pickups
        and o.interactions >= threshold.interactions
        and o.deliveries >= threshold.deliveries
        and o.charges >= threshold.charges
        and o.gathered >= threshold.gathered
        and o.gathered > threshold.gathered_above
        and (threshold.fitness_above is None or o.fitness > threshold.fitness_above)
    )


def tiers(o: Outcome, classes: Classes) -> tuple[Tier, ...]:
    """The tiers an individual reaches, best first."""
    found = [tier for tier in Tier if reaches(o, classes.tiers[tier])]
    if classes.excellent_is_complete and Tier.COMPLETE not in found and Tier.EXCELLENT in found:
        found.remove(Tier.EXCELLENT)
    return tuple(found)
