"""One question and its repairs: ask, check, and say what was wrong, for the model to mend it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from islandgp.supervision.llm.calls import Calls
from islandgp.supervision.llm.message import QUOTED, Failure, Request
from islandgp.supervision.llm.transcript import Call, Conclusion
from islandgp.supervision.llm.validation import Check, Rejection, RejectionStage

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Conversation(Generic[T]):
    """What became of a question."""

    value: T | None  # None: no usable answer
    source: str  # "llm", "llm, repaired", "llm, clamped from 0.8", "fallback"
    why: str  # of the fallback, else ""
    rejected: tuple[RejectionStage, ...]  # stages that turned an answer away, in order
    prompts: tuple[str, ...]  # SHA-256 of each rendered prompt, hexadecimal
    trial: str = ""  # which of several candidates was chosen, and why


def converse(
    calls: Calls,
    generation: int,
    part: str,
    request: Request,
    check: Check[T],
    *,
    repairs: int,
    repair: Callable[[Rejection], str],
) -> Conversation[T]:
    """Asks, with at most `repairs` turns more; `repair` words what is wrong."""
    rejected: list[RejectionStage] = []
    prompts: list[str] = []
    why = ""
    for turn in range(1 + repairs):
        prompts.append(request.prompt_digest)
        answer = calls.ask(Call(generation, part, turn), request)
        if isinstance(answer, Failure):
            why = f"{answer.kind}: {answer.message}"
            break
        found = check(answer)
        if not isinstance(found, Rejection):
            words = ("llm", "repaired" if turn else "", found.change)
            source = ", ".join(word for word in words if word)
            return _concluded(
                calls,
                generation,
                part,
                Conversation(found.value, source, "", tuple(rejected), tuple(prompts)),
            )
        rejected.append(found.stage)
        why = f"{found.stage}: {found.error}"
        if found.stage is RejectionStage.REFUSED:
            break
        request = request.followed_by(answer.text[:QUOTED], repair(found))
    outcome: Conversation[T] = Conversation(None, "fallback", why, tuple(rejected), tuple(prompts))
    return _concluded(calls, generation, part, outcome)


def unasked(calls: Calls, generation: int, part: str, why: Failure) -> Conversation[T]:
    """A question that is not asked, and why."""
    outcome: Conversation[T] = Conversation(None, "fallback", f"{why.kind}: {why.message}", (), ())
    return _concluded(calls, generation, part, outcome)


def _concluded(
    calls: Calls, generation: int, part: str, outcome: Conversation[T]
) -> Conversation[T]:
    found = Conclusion(generation, part, outcome.source, outcome.why, outcome.rejected)
    calls.transcript.conclude(found)
    return outcome
