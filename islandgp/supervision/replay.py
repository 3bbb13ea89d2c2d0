"""Replays a run with a language model offline, with the answers of its transcript.

States, prompts, validation and fallback are computed again by the same code; only the answers of
the server are read. So the records are equal bit for bit, or the replay ends with an error that
shows the first difference.
"""

from __future__ import annotations

import json
from difflib import unified_diff
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import BaseModel

from islandgp.errors import SupervisionError
from islandgp.gate import must_be_known_code
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance, RunContext
from islandgp.supervision.llm.message import Failure, Reply, Request
from islandgp.supervision.llm.settings import READS, LLMSettings
from islandgp.supervision.llm.supervisor import Adviser
from islandgp.supervision.llm.transcript import Call, Transcript, find_transcript


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


class Replay:
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
                f" {type(error).__name__}: {error}."
            ) from None
        return cls(Adviser(recorded, context), transcript)

    def __init__(self, adviser: Adviser, transcript: Transcript) -> None:
        self.adviser = adviser
        self._calls = RecordedCalls(transcript)

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.adviser.on_generation(generation)

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`.

        Raises:
            SupervisionError: the transcript has no answer for this state.
        """
        return self.adviser.advise(state, rng, self._calls)


class RecordedCalls:
    """Answers from a transcript."""

    def __init__(self, transcript: Transcript) -> None:
        self.transcript = transcript

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """See `Calls`.

        Raises:
            SupervisionError: the transcript has no answer, or one for another request.
        """
        done = self.transcript.of(call)
        name = self.transcript.path or "the transcript"
        if not done:
            raise SupervisionError(
                f"Expected an answer in {name} for the {call}, found none: the recorded run"
                " ended earlier, or made fewer requests."
            )
        same = [a for a in done if a.request.digest == request.digest]
        if not same:
            raise SupervisionError(
                f"Expected the recorded request in {name} for the {call}, found another one:\n"
                + difference(done[-1].request, request)
                + "\nA replay needs the code, the prompts, the configuration and the seed of the"
                " recorded run, and its answers as they were."
            )
        return same[-1].answer


def difference(recorded: Request, now: Request) -> str:
    """The unified diff of two requests, at most 40 lines."""
    texts = (_lines(recorded), _lines(now))
    return "\n".join(islice(unified_diff(*texts, "recorded", "now", lineterm="", n=1), 40))


def _lines(request: Request) -> list[str]:
    plain = request.plain()
    turns = [line for turn in request.turns for line in turn.splitlines()]
    rest = {key: value for key, value in plain.items() if key not in ("system", "turns")}
    settings = [f"{key}: {json.dumps(value)}" for key, value in rest.items()]
    return [*settings, *request.system.splitlines(), *turns]
