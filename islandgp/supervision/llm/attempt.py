"""The nouns of a transcript: a call, the attempts at it, and what became of a part of guidance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage


@dataclass(frozen=True, slots=True)
class Call:
    """Where in a run a call belongs."""

    generation: int  # whose state is asked about; -1 for the probe
    part: str  # "rate", "tree" or "probe"
    turn: int  # 0: the question, 1 and up: repairs

    def __str__(self) -> str:
        turn = f", repair {self.turn}" if self.turn else ""
        return f"{self.part} after generation {self.generation}{turn}"


@dataclass(frozen=True, slots=True)
class Sent:
    """An attempt that is about to be made."""

    call: Call
    number: int  # from 1
    at_most: Usage  # tokens that it can take


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt at a call."""

    call: Call
    number: int  # from 1
    request: Request
    answer: Reply | Failure
    usage: Usage | None  # tokens; None: nobody knows
    at_most: Usage  # tokens that it may have taken; `usage` where that is known
    usd: float | None  # of `usage`; None: unknown tokens or an unknown price
    seconds: float  # until the answer
    waited: float  # s before the attempt
    at: str  # ISO time of the start


@dataclass(frozen=True, slots=True)
class Conclusion:
    """What became of one part of the guidance of a generation."""

    generation: int
    part: str
    source: str  # "llm", "llm, repaired", "fallback", ...
    why: str  # of a fallback, else ""
    rejected: tuple[str, ...]  # stages of the validation, in order


@dataclass(frozen=True, slots=True)
class Played:
    """Episodes that supervision ran for itself."""

    generation: int
    purpose: str  # "traces": told in a prompt; "trial": of candidates
    episodes: int
    gain: float = 0.0  # of a trial: points that the choice has above the first candidate


def to_line(attempt: Attempt, system: str) -> dict[str, Any]:
    """An attempt as JSON values; `system` is the hash under which its system prompt stands."""
    request = attempt.request.plain()
    answer = attempt.answer
    return {
        **asdict(attempt.call),
        "attempt": attempt.number,
        "at": attempt.at,
        "request": {**request, "system": system},
        "digest": attempt.request.digest,
        "prompt": attempt.request.prompt_digest,
        "reply": asdict(answer) if isinstance(answer, Reply) else None,
        "failure": asdict(answer) if isinstance(answer, Failure) else None,
        "usage": None if attempt.usage is None else asdict(attempt.usage),
        "at_most": asdict(attempt.at_most),
        "usd": attempt.usd,
        "seconds": attempt.seconds,
        "waited": attempt.waited,
    }


def from_line(line: Mapping[str, Any], systems: Mapping[str, str]) -> Attempt:
    """An attempt from its JSON values; `systems` are the system prompts by hash.

    Raises:
        ValueError, KeyError, TypeError: they are not those of an attempt.
    """
    said = line["request"]
    request = Request(**{**said, "system": systems[said["system"]], "turns": tuple(said["turns"])})
    answer: Reply | Failure
    if line["reply"] is not None:
        reply = line["reply"]
        answer = Reply(**{**reply, "usage": _usage(reply["usage"])})
    else:
        failure = line["failure"]
        answer = Failure(**{**failure, "kind": FailureKind(failure["kind"])})
    return Attempt(
        call=Call(line["generation"], line["part"], line["turn"]),
        number=line["attempt"],
        request=request,
        answer=answer,
        usage=_usage(line["usage"]),
        at_most=Usage(**line["at_most"]),
        usd=line["usd"],
        seconds=line["seconds"],
        waited=line["waited"],
        at=line["at"],
    )


def _usage(found: Mapping[str, Any] | None) -> Usage | None:
    return None if found is None else Usage(**found)
