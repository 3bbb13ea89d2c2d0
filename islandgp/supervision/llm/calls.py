"""Calls: requests with retries, recorded in the transcript.

`LiveCalls` uses the network, except for calls that are in the transcript already.
`supervision.replay.RecordedCalls` uses a transcript only.

This is the only layer with retries (section 2.4.5). `converse` sends a question and, if the answer
is rejected, repair turns that quote the error. `supported` and `ask_with_less` find out what a
server accepts: optional parameters that it rejects are left out.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Final, Protocol

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import Guidance
from islandgp.supervision.llm.answers import Accepted, Check, Rejection, RejectionStage
from islandgp.supervision.llm.budget import Ledger, Pace, known_usage, most_tokens
from islandgp.supervision.llm.message import (
    CHARGED,
    HOPELESS,
    MAX_QUOTED,
    TRANSIENT,
    Client,
    Failure,
    FailureKind,
    Reply,
    Request,
)
from islandgp.supervision.llm.settings import LLMSettings, Outage
from islandgp.supervision.llm.transcript import Attempt, Call, Conclusion, Sent, Transcript

REASON: Final = 600  # most characters of a fallback's reason in the record
SLOTS: Final = {"probe": 0, "rate": 1, "tree": 2, "edits": 3}  # of Stream.NETWORK
OPTIONAL: Final = {
    "temperature": r"temperature|sampling|top[_ ][pk]\b",
    "grammar": r"grammar|structured_outputs",
    "schema": r"output_config|output_format|schema|structured|json|response_format",
}
"""Parameters of requests that a server may reject, with patterns of their names in its errors."""


class Calls(Protocol):
    """Interface of what answers calls: the network or a transcript."""

    transcript: Transcript  # of all calls so far

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """Returns the answer to a call after all attempts.

        Args:
            call: its place in the run.
            request: the request.
        """
        ...


class LiveCalls:
    """Sends requests by a client, within the caps."""

    def __init__(
        self,
        client: Client,
        transcript: Transcript,
        settings: LLMSettings,
        *,
        seed: int,
        on_outage: Outage | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Sends nothing yet.

        Args:
            client: makes the attempts.
            transcript: of the run.
            settings: of the model: caps, attempts, waiting times and turns with other runs.
            seed: of the run, for the jitter of waiting times.
            on_outage: what follows the last attempt; "wait" has no last one before the caps. None:
                as the settings say.
            sleep: replaces time.sleep in tests.
        """
        self.client, self.transcript, self.seed, self.sleep = client, transcript, seed, sleep
        self.ledger = Ledger(transcript, settings.price, settings.caps)
        self.retry = settings.retry.model_copy(update={"deadline": settings.deadline})
        self.on_outage = on_outage or settings.on_outage
        self.pace = Pace.of(settings)
        self._closed = False

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """See `Calls`. An answer in the transcript to the same request is used again.

        Raises:
            SupervisionError: no answer, and `on_outage` is "stop"; or "wait", and waiting is no
                help.
        """
        done = [a for a in self.transcript.of(call) if a.request.digest == request.digest]
        slot = 10 * SLOTS[call.part] + call.turn
        rng = stream(self.seed, Stream.NETWORK, generation=call.generation + 1, slot=slot)
        answer, number = (done[-1].answer, done[-1].number) if done else (None, 0)
        if isinstance(answer, Failure) and self._stops(call, answer):
            answer, number = None, 0  # it stopped the run, or kept it from starting
        while answer is None or not self._is_last(call, answer, number):
            waited = 0.0
            if isinstance(answer, Failure):
                waited = min(self._delay(answer, number, rng), self.ledger.seconds_left())
                self.sleep(waited)
            waited += self.pace.wait(request) if self.pace is not None else 0
            number += 1
            answer = self._attempt(call, number, request, waited)
        if isinstance(answer, Failure) and call.part != "probe" and self._stops(call, answer):
            raise SupervisionError(
                f"Expected an answer of the model {request.model}, found {answer.kind}"
                f" ({answer.message}); the run stops"
                f" (supervisor.policy.on_outage={self.on_outage})."
                " The same command continues it once the server answers."
            )
        return answer

    def _is_last(self, call: Call, answer: Reply | Failure, attempt: int) -> bool:
        """True if no attempt follows; "wait" waits on while that costs nothing, up to the caps."""
        if isinstance(answer, Reply) or answer.kind not in TRANSIENT:
            return True
        is_long = (answer.retry_after or 0) > self.retry.retry_after_most
        if self.on_outage != "wait" or answer.kind in CHARGED or call.part == "probe":
            return attempt >= self.retry.attempts or (is_long and self.on_outage != "wait")
        if attempt % self.retry.attempts == 0:
            logging.getLogger("islandgp").warning(
                "No answer of the model (%s); it is asked again (on_outage=wait)", answer.message
            )
        return False

    def _delay(self, failure: Failure, attempt: int, rng: np.random.Generator) -> float:
        """Seconds to wait after the failed attempt number `attempt` (from 1).

        At least what the server requests; otherwise exponential backoff times a factor in [0.5, 1],
        so that the runs of a sweep do not retry at the same time.
        """
        backoff = min(self.retry.longest_wait, self.retry.first_wait * 2.0 ** (attempt - 1))
        return max(failure.retry_after or 0.0, backoff * float(rng.uniform(0.5, 1)))

    def _stops(self, call: Call, failure: Failure) -> bool:
        """True if a failure stops the run, or keeps it from starting."""
        if call.part == "probe":
            return failure.kind is not FailureKind.BUDGET
        stopping = {"fallback": frozenset[FailureKind](), "wait": HOPELESS}
        return failure.kind in stopping.get(self.on_outage, HOPELESS | TRANSIENT)

    def close(self) -> None:
        """Ends a call in another thread without recording it; a resumed run makes it again."""
        self._closed = True

    def _attempt(self, call: Call, number: int, request: Request, waited: float) -> Reply | Failure:
        self._check_open()
        self.client.open()
        bound = most_tokens(request)
        at, began = datetime.now(UTC).isoformat(timespec="milliseconds"), time.monotonic()
        seconds = min(self.retry.deadline, self.ledger.seconds_left() - waited)
        answer: Reply | Failure
        if reason := self.ledger.over(bound, waited):
            answer = Failure(FailureKind.BUDGET, reason)
        else:
            self.transcript.add(Sent(call, number, bound, round(waited + seconds, 3)))
            answer = self.client.send(request, seconds=seconds)
        self._check_open()
        usage = known_usage(answer)
        attempt = Attempt(
            call=call,
            number=number,
            request=request,
            answer=answer,
            usage=usage,
            at_most=bound if usage is None else usage,
            usd=None if usage is None else self.ledger.usd(usage),
            seconds=round(time.monotonic() - began, 3),
            waited=round(waited, 3),
            at=at,
        )
        self.transcript.add(attempt)
        return answer

    def _check_open(self) -> None:
        if self._closed:
            raise SupervisionError("The run has ended; this answer is not needed.")


def supported(request: Request, transcript: Transcript, generation: int) -> Request:
    """The request without the optional parameters that the last reply before a generation lacked.

    A grammar is also left out if the server ignored it, so that the answer is no JSON object.
    """
    replies = [
        (a.request, a.answer)
        for a in transcript.attempts
        if a.call.generation < generation and isinstance(a.answer, Reply)
    ]
    if not replies:
        return request
    known, reply = replies[-1]
    lacks = [name for name in OPTIONAL if getattr(known, name) is None]
    if reply.stop_reason == "end_turn" and not reply.text.lstrip().startswith("{"):
        lacks.append("grammar")
    return request.without(lacks)


def ask_with_less(calls: Calls, call: Call, request: Request) -> tuple[Request, Reply | Failure]:
    """The answer to a call, and its request, without the parameters that the server rejects.

    The next request lacks the parameter that the error names, else the first one.
    """
    while True:
        answer = calls.ask(call, request)
        sent = [name for name in OPTIONAL if getattr(request, name) is not None]
        if isinstance(answer, Reply) or answer.kind is not FailureKind.REJECTED or not sent:
            return request, answer
        text = answer.message.lower()
        named = [name for name in sent if re.search(OPTIONAL[name], text)]
        request = request.without((named or sent)[:1])


Answer = tuple[Guidance | None, dict[str, str]]
"""The guidance for a part, None without a usable answer; and notes for the record."""


def converse(
    calls: Calls,
    generation: int,
    part: str,
    request: Request,
    check: Check,
    *,
    repairs: int,
    repair: Callable[[Rejection], str],
) -> Answer:
    """Asks a question, with repair turns if the answer is rejected.

    Args:
        calls: to make the calls with.
        generation: to which the question belongs.
        part: of the guidance.
        request: the question.
        check: accepts or rejects an answer.
        repairs: most repair turns, >= 0.
        repair: makes the text of a repair turn from a rejection.

    Returns:
        The guidance and notes; the conclusion is added to the transcript.
    """
    rejected: list[RejectionStage] = []
    prompts: list[str] = []
    guidance, source, reason, failed = None, "fallback", "", ""
    for turn in range(1 + repairs):
        prompts.append(request.prompt_digest)
        request, answer = ask_with_less(calls, Call(generation, part, turn), request)
        if isinstance(answer, Failure):
            reason, failed = f"{answer.kind}: {answer.message}", answer.kind.value
            break
        checked = check(answer)
        if isinstance(checked, Accepted):
            parts = ("llm", "repaired" if turn else "", checked.change)
            guidance, source, reason = checked.guidance, ", ".join(filter(None, parts)), ""
            break
        rejected.append(checked.stage)
        reason = f"{checked.stage}: {checked.error}"
        if checked.stage is RejectionStage.REFUSED:
            break
        request = request.followed_by(answer.text[:MAX_QUOTED], repair(checked))
    end = Conclusion(generation, part, source, reason, tuple(rejected), failed)
    return guidance, concluded(calls, end, prompts)


def concluded(calls: Calls, end: Conclusion, prompts: Sequence[str] = ()) -> dict[str, str]:
    """Adds a conclusion to the transcript; returns its notes, with the hashes of the prompts."""
    calls.transcript.add(end)
    why = f": {end.why[:REASON]}" if end.why else ""
    more = {"prompts": " ".join(prompts), "rejected": " ".join(end.rejected)}
    notes = {f"{end.part}_{name}": text for name, text in more.items() if text}
    return {end.part: end.source + why, **notes}
