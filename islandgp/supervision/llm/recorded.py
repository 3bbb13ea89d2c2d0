"""Calls that are answered from a transcript: nobody is asked."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.attempt import Call, Conclusion, Played
from islandgp.supervision.llm.message import Failure, Reply, Request
from islandgp.supervision.llm.transcript import Transcript


class RecordedCalls:
    """Answers from a transcript, which stays as it is."""

    def __init__(self, transcript: Transcript) -> None:
        self.transcript = transcript

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """See `Calls`.

        Raises:
            SupervisionError: the transcript has no answer, or one to another request.
        """
        done = self.transcript.of(call)
        name = self.transcript.path or "the transcript"
        if not done:
            raise SupervisionError(
                f"Expected an answer in {name} for the {call}, found none: the recorded run"
                " ended before, or asked for less."
            )
        same = [a for a in done if a.request.digest == request.digest]
        if not same:
            raise SupervisionError(
                f"Expected the recorded request in {name} for the {call}, found another one:\n"
                + difference(done[-1].request, request)
                + "\nA replay needs the code, the prompts, the configuration and the seed of the"
                " recorded run."
            )
        return same[-1].answer

    def conclude(self, part: Conclusion) -> None:
        """See `Calls`."""

    def play(self, played: Played) -> None:
        """See `Calls`."""

    def learn(self, generation: int, dialect: Mapping[str, Any]) -> None:
        """See `Calls`."""

    def useless_before(self, generation: int) -> int:
        """See `Calls`."""
        return self.transcript.useless_before(generation)

    def room_for(self, requests: Sequence[Request], repairs: int) -> bool:  # noqa: ARG002 -- the protocol's
        """See `Calls`: nothing is gained by it."""
        return False


def difference(recorded: Request, now: Request) -> str:
    """Where two requests differ, as a unified diff of at most 40 lines."""
    lines = list(
        difflib.unified_diff(_lines(recorded), _lines(now), "recorded", "now", lineterm="", n=1)
    )
    more = [f"... and {len(lines) - 40} lines more"] if len(lines) > 40 else []
    return "\n".join(lines[:40] + more)


def _lines(request: Request) -> list[str]:
    plain = request.plain()
    turns = [line for turn in request.turns for line in turn.splitlines()]
    rest = {key: value for key, value in plain.items() if key not in ("system", "turns")}
    settings = [f"{key}: {json.dumps(value)}" for key, value in rest.items()]
    return [*settings, *request.system.splitlines(), *turns]
