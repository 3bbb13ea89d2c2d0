"""Supervisors that configuration can choose, as a user may write them: wrong in one way each."""

from __future__ import annotations

from typing import Any

import numpy as np

from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, RunContext
from islandgp.supervision.baseline import BaselineSettings


class Answers:
    """A supervisor whose answer is set at its creation."""

    name = "answers"
    Settings = BaselineSettings

    @classmethod
    def make(cls, settings: BaselineSettings, context: RunContext) -> Any:  # noqa: ARG003 -- the protocol's
        """See `Supervisor`."""
        return cls(Guidance(settings.rates[0], None, cls.name))

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:  # noqa: ARG002 -- the protocol's
        """See `Supervisor`."""
        guidance: Guidance = self.answer
        return guidance


class TooMuch(Answers):
    """Wants a rate of 5."""

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:  # noqa: ARG002 -- the protocol's
        """See `Supervisor`."""
        return Guidance(5, None, self.name)
