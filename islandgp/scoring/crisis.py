"""The emergency override: Eq. (7) and (8), section 2.4.3."""

from __future__ import annotations

from pydantic import BaseModel, Field


class Crisis(BaseModel, frozen=True, extra="forbid"):
    """When evolution is in a crisis, and the rate that is then enforced."""

    diversity_below: float = Field(ge=0, le=1)  # Eq. (7): threshold of Eq. (3)
    stagnant_epochs_above: float = Field(ge=0)  # Eq. (7): epochs without a better best
    emergency_rate: float = Field(ge=0, le=1)  # Eq. (8)

    def reason(self, diversity: float, stagnant_epochs: float) -> str:
        """Eq. (7): "diversity" or "stagnation", or "" when there is no crisis."""
        if diversity < self.diversity_below:
            return "diversity"
        return "stagnation" if stagnant_epochs > self.stagnant_epochs_above else ""

    def rate(self, wanted: float, reason: str) -> float:
        """Eq. (8): the emergency rate in a crisis, else what the supervisor wanted."""
        return self.emergency_rate if reason else wanted
