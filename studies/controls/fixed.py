"""A constant mutation rate and no tree: the simplest control arm."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, Field

from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, RunContext


class FixedSettings(BaseModel, frozen=True, extra="forbid"):
    """The constant rate."""

    rate: float = Field(ge=0, le=1)  # of mutation, in every generation


class Fixed:
    """Advises the same mutation rate in every generation, and no tree."""

    name = "fixed"
    Settings = FixedSettings

    @classmethod
    def make(cls, settings: FixedSettings, context: RunContext) -> Fixed:  # noqa: ARG003 -- the protocol's
        """See `Supervisor`."""
        return cls(settings)

    def __init__(self, settings: FixedSettings) -> None:
        self.settings = settings

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:  # noqa: ARG002 -- the protocol's
        """See `Supervisor`."""
        return Guidance(self.settings.rate, None, self.name, reasoning="constant")
