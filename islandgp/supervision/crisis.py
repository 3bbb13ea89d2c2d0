"""The emergency override: Eq. (7) and (8), section 2.4.3."""

from __future__ import annotations

from pydantic import BaseModel, Field

from islandgp.scoring.state import PopulationState


class Crisis(BaseModel, frozen=True, extra="forbid"):
    """When evolution is in a crisis, and the rate that is then enforced."""

    diversity_below: float = Field(ge=0, le=1)  # Eq. (7): threshold of Eq. (3)
    stagnant_epochs_above: float = Field(ge=0)  # Eq. (7): epochs without a better best
    emergency_rate: float = Field(ge=0, le=1)  # Eq. (8)


def crisis_reason(state: PopulationState, crisis: Crisis) -> str:
    """Eq. (7): why this is a crisis, or "" when it is none."""
    if state.now.diversity < crisis.diversity_below:
        return "diversity"
    if state.stagnant_epochs > crisis.stagnant_epochs_above:
        return "stagnation"
    return ""


def applied_rate(wanted: float, reason: str, crisis: Crisis) -> float:
    """Eq. (8): the emergency rate in a crisis, else what the supervisor wanted."""
    return crisis.emergency_rate if reason else wanted
