"""The paper's baseline: reactive mutation control by stagnation alone (section 3.1)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import BaseModel, Field

from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, Rates, RunContext


class BaselineSettings(BaseModel, frozen=True, extra="forbid"):
    """Response of the mutation rate to the best fitness."""

    patience: int = Field(ge=1)  # generations without improvement before the rate rises
    up: float = Field(ge=1)  # factor on the rate on stagnation
    down: float = Field(gt=0, le=1)  # factor on the rate on improvement
    rates: Rates
    reads: ClassVar = {"rate": ("supervisor.policy", "gp.state")}


class Baseline:
    """Raises the rate on stagnation and lowers it on improvement; injects no trees."""

    name = "baseline"
    Settings = BaselineSettings

    @classmethod
    def make(cls, settings: BaselineSettings, context: RunContext) -> Baseline:  # noqa: ARG003 -- the protocol's
        """See `Supervisor`."""
        return cls(settings)

    def __init__(self, settings: BaselineSettings) -> None:
        self.settings = settings

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:  # noqa: ARG002 -- the protocol's
        """See `Supervisor`. The present rate times a factor, within the limits."""
        settings, stuck = self.settings, state.stagnant_generations
        if state.best_rose:
            factor, reason = settings.down, "the best fitness rose"
        elif stuck >= settings.patience:
            factor, reason = settings.up, f"no better fitness for {stuck} generations"
        else:
            factor, reason = 1.0, "waiting"
        least, most = settings.rates
        rate = min(most, max(least, state.mutation_rate * factor))
        return Guidance(rate, None, self.name, reasoning=reason)
