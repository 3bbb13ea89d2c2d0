"""A recorded run again, offline: the answers come from its transcript.

The states, the prompts, the validation and the fallback are worked out anew, by the
same code as in the recorded run; only the network's part is read. So the
records come out the same bit for bit, or the replay ends with the difference.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from islandgp.errors import SupervisionError
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance, RunContext, Seen
from islandgp.supervision.llm.adviser import Adviser
from islandgp.supervision.llm.capabilities import Dialect, Dialects
from islandgp.supervision.llm.recorded import RecordedCalls
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Transcript, find_transcript


class ReplaySettings(BaseModel, frozen=True, extra="forbid"):
    """Which record to repeat."""

    transcript: str | None  # a run's folder, or a transcript.jsonl

    def path(self) -> Path:
        """The file. Raises SupervisionError where there is none."""
        if not self.transcript:
            raise SupervisionError(
                "Expected a recorded run to replay, found none; name its folder with"
                " supervisor.policy.transcript=..."
            )
        return find_transcript(Path(self.transcript))


class Replay:
    """Gives the guidance of a recorded run; its record keeps the recorded source."""

    name = "replay"
    Settings = ReplaySettings

    @classmethod
    def ready(cls, settings: ReplaySettings, setup: RunContext) -> None:  # noqa: ARG003 -- the protocol's
        """Raises SupervisionError where there is no transcript."""
        settings.path()

    @classmethod
    def make(cls, settings: ReplaySettings, setup: RunContext) -> Replay:
        """See `Supervisor`."""
        path = settings.path()
        transcript = Transcript(path)
        try:
            start = transcript.start or {}
            recorded = LLMSettings.model_validate(start["settings"])
            if start["dialect"] is not None:
                Dialect(**start["dialect"])
        except (KeyError, TypeError, ValidationError) as error:
            raise SupervisionError(
                f"Expected the settings of a recorded run at the top of {path}, found"
                f" {type(error).__name__}: {error}."
            ) from None
        return cls(Adviser(recorded, setup), transcript)

    def __init__(self, adviser: Adviser, transcript: Transcript) -> None:
        self.adviser = adviser
        self._calls = RecordedCalls(transcript)
        self._dialects = Dialects(adviser.settings, transcript, self._calls)

    def see(self, generation: Seen) -> None:
        """See `Witness`."""
        self.adviser.see(generation)

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`.

        Raises:
            SupervisionError: the record has no answer to this state.
        """
        return self.adviser.advise(state, rng, self._calls, self._dialects.at)
