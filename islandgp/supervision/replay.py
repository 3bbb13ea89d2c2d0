"""Replays a run with a language model offline, with the answers of its transcript.

States, prompts, validation and fallback are computed again by the same code; only the answers of
the server are read. So the records are equal bit for bit, or the replay ends with an error that
shows the first difference.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from pydantic import BaseModel

from islandgp.errors import SupervisionError, brief
from islandgp.gate import must_be_known_code
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.calls import Calls
from islandgp.supervision.llm.settings import READS, LLMSettings
from islandgp.supervision.llm.supervisor import Adviser
from islandgp.supervision.llm.transcript import Transcript, find_transcript


class ReplaySettings(BaseModel, frozen=True, extra="forbid"):
    """The recorded run to replay."""

    transcript: str | None  # a run's folder, or a transcript.jsonl
    reads: ClassVar = dict.fromkeys(("rate", "tree", "edits"), READS)

    def path(self) -> Path:
        """The transcript's file. Raises SupervisionError if there is none."""
        if not self.transcript:
            raise SupervisionError(
                "Expected a recorded run to replay, found none; name its folder with"
                " supervisor.policy.transcript=..."
            )
        return find_transcript(Path(self.transcript))


class Replay(Adviser):
    """Returns the guidance of a recorded run, under the recorded source."""

    name = "replay"
    Settings = ReplaySettings

    @classmethod
    def check(cls, settings: ReplaySettings, context: RunContext) -> None:  # noqa: ARG003 -- the protocol's
        """Raises SupervisionError if there is no transcript."""
        settings.path()

    @classmethod
    def make(cls, settings: ReplaySettings, context: RunContext) -> Replay:
        """See `Supervisor`.

        Raises:
            SupervisionError: the transcript has no settings, or damaged ones.
            UntrustedError: the class of its fallback is not in the user's own configuration.
        """
        path = settings.path()
        transcript = Transcript(path, fixed=True)
        try:
            values = {} if transcript.start is None else transcript.start.settings
            must_be_known_code(values)
            recorded = LLMSettings.model_validate(values)
        except ValueError as error:
            raise SupervisionError(
                f"Expected the settings of a recorded run at the top of {path}, found"
                f" {'none' if not values else brief(error)}; give the transcript of a whole run."
            ) from None
        return cls(recorded, context, Calls(None, transcript, recorded, seed=context.seed))
