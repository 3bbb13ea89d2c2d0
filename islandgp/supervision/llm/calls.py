"""Calls: requests with retries, recorded in the transcript.

`LiveCalls` uses the network, except for calls that are in the transcript already.
`supervision.replay.RecordedCalls` uses a transcript only.

This is the only layer with retries (section 2.4.5). `converse` sends a question and, if the answer
is rejected, repair turns that quote the error.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import inf
from threading import Lock, Thread
from typing import Final, Protocol, TypeVar

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import Guidance
from islandgp.supervision.llm.answers import Accepted, Rejection, RejectionStage
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
from islandgp.supervision.llm.settings import Outage, RetrySettings
from islandgp.supervision.llm.transcript import Attempt, Call, Conclusion, Sent, Transcript

T = TypeVar("T")
Check = Callable[[Reply], Accepted | Rejection]


def final(answer: Reply | Failure, attempt: int, settings: RetrySettings) -> bool:
    """True if no further attempt follows the one with number `attempt` (from 1)."""
    if isinstance(answer, Reply) or attempt >= settings.attempts:
        return True
    requested = answer.should_retry  # by the server
    may_help = answer.kind in TRANSIENT if requested is None else requested
    return not may_help or (answer.retry_after or 0) > settings.retry_after_most


def wait(
    failure: Failure, attempt: int, settings: RetrySettings, rng: np.random.Generator
) -> float:
    """Seconds to wait after the failed attempt number `attempt` (from 1).

    At least what the server requests; otherwise exponential backoff times a factor in [0.5, 1], so
    that the runs of a sweep do not retry at the same time.
    """
    backoff = min(settings.longest_wait, settings.first_wait * 2.0 ** (attempt - 1))
    return max(failure.retry_after or 0.0, backoff * float(rng.uniform(0.5, 1)))


def _never_there(call: Call, failure: Failure) -> bool:
    """True if there is no server at the start of a run: its address may be wrong."""
    return call.generation < 0 and failure.kind is FailureKind.UNREACHABLE


SLOTS: Final = {"probe": 0, "rate": 1, "tree": 2, "edits": 3}  # of Stream.NETWORK


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
        ledger: Ledger,
        retry: RetrySettings,
        *,
        seed: int,
        on_outage: Outage = "fallback",
        pace: Pace | None = None,
        sleep: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Sends nothing yet.

        Args:
            client: makes the attempts.
            transcript: of the run.
            ledger: of the run, with its caps.
            retry: number of attempts and waiting times.
            seed: of the run, for the jitter of waiting times.
            on_outage: what follows the last attempt; "wait" has no last one before the caps.
            pace: turns with other runs; None: requests are sent at once.
            sleep: replaces time.sleep in tests.
            clock: replaces time.monotonic in tests.
        """
        self.client, self.transcript, self.ledger, self.retry = client, transcript, ledger, retry
        self.seed, self.on_outage = seed, on_outage
        self.sleep, self.clock, self.pace = sleep, clock, pace
        self._closed = False
        self._sending = Lock()  # held from the check of the caps until the request is recorded
        self._not_before = -inf  # clock time before which the server accepts no request

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
        earlier = 0  # attempts before the one that stopped the run or kept it from starting
        if isinstance(answer, Failure) and self._asks_again(call, answer):
            answer, earlier = None, number
        while answer is None or not self._ends(call, answer, number - earlier):
            if isinstance(answer, Failure):
                due = wait(answer, number - earlier, self.retry, rng)
            else:  # a waiting time requested for an earlier call holds for this one as well
                due = max(0.0, self._not_before - self.clock())
            due = min(due, self.ledger.seconds_left())
            if due:
                self.sleep(due)
            due += self.pace.wait(request) if self.pace is not None else 0
            number += 1
            answer = self._attempt(call, number, request, due)
        if isinstance(answer, Failure) and self._stops(call, answer):
            raise SupervisionError(
                f"Expected an answer of the model {request.model}, found {answer.kind}"
                f" ({answer.message}); the run stops"
                f" (supervisor.policy.on_outage={self.on_outage})."
                " The same command continues it once the server answers."
            )
        return answer

    def _ends(self, call: Call, answer: Reply | Failure, attempt: int) -> bool:
        """True if no attempt follows; "wait" waits on while that costs nothing, up to the caps."""
        if (
            self.on_outage != "wait"
            or isinstance(answer, Reply)
            or answer.kind not in TRANSIENT - CHARGED
            or _never_there(call, answer)
        ):
            return final(answer, attempt, self.retry)
        if attempt % self.retry.attempts == 0:
            logging.getLogger("islandgp").warning(
                "No answer of the model (%s); it is asked again (on_outage=wait)", answer.message
            )
        return False

    def _stops(self, call: Call, failure: Failure) -> bool:
        """True if a failure stops the run; the probe reports lasting ones itself."""
        lasting = failure.kind in HOPELESS and call.part != "probe"
        lost = failure.kind in TRANSIENT and not _never_there(call, failure)
        return {"fallback": False, "wait": lasting, "stop": lasting or lost}[self.on_outage]

    def _asks_again(self, call: Call, failure: Failure) -> bool:
        """True if a recorded failure stopped the run, or kept it from starting."""
        if failure.kind is FailureKind.BUDGET:
            return False
        at_start = call.part == "probe" and (call.generation < 0 or failure.kind not in TRANSIENT)
        return at_start or self._stops(call, failure)

    def close(self) -> None:
        """Ends a call in another thread without recording it; a resumed run makes it again."""
        self._closed = True

    def _attempt(self, call: Call, number: int, request: Request, waited: float) -> Reply | Failure:
        self._check_open()
        bound = most_tokens(request)
        self.client.open()
        at, began = datetime.now(UTC).isoformat(timespec="milliseconds"), self.clock()
        answer: Reply | Failure
        with self._sending:
            seconds = min(self.retry.deadline, self.ledger.seconds_left() - waited)
            if not (reason := self.ledger.over(bound, waited)):
                self.transcript.add(Sent(call, number, bound, round(waited + seconds, 3)))
        if reason:
            answer = Failure(FailureKind.BUDGET, reason)
        else:
            answer = self._with_remedy(self.client.send(request, seconds=seconds), seconds)
        retry_after = answer.retry_after if isinstance(answer, Failure) else None
        if retry_after is not None and retry_after <= self.retry.retry_after_most:
            self._not_before = self.clock() + retry_after
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
            seconds=round(self.clock() - began, 3),
            waited=round(waited, 3),
            at=at,
        )
        self.transcript.add(attempt)
        return answer

    def _with_remedy(self, answer: Reply | Failure, seconds: float) -> Reply | Failure:
        """The answer; the message of a timeout names the setting that allows more time."""
        if isinstance(answer, Reply) or answer.kind is not FailureKind.TIMEOUT:
            return answer
        setting = "caps.seconds" if seconds < self.retry.deadline else "retry.deadline"
        remedy = f"raise supervisor.policy.{setting}, a model that thinks may need minutes"
        return replace(answer, message=f"{answer.message}; {remedy}")

    def _check_open(self) -> None:
        if self._closed:
            raise SupervisionError("The run has ended; this answer is not needed.")


@dataclass(frozen=True, slots=True)
class Conversation:
    """The result of a question with its repair turns."""

    guidance: Guidance | None  # None: no usable answer
    end: Conclusion  # as recorded in the transcript
    prompts: tuple[str, ...] = ()  # SHA-256 of each rendered prompt, hexadecimal


def converse(
    calls: Calls,
    generation: int,
    part: str,
    request: Request,
    check: Check,
    *,
    repairs: int,
    repair: Callable[[Rejection], str],
) -> Conversation:
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
        The guidance or None, with the conclusion that was added to the transcript.
    """
    rejected: list[RejectionStage] = []
    prompts: list[str] = []
    accepted, source, reason, failed = None, "fallback", "", ""
    for turn in range(1 + repairs):
        prompts.append(request.prompt_digest)
        answer = calls.ask(Call(generation, part, turn), request)
        if isinstance(answer, Failure):
            reason, failed = f"{answer.kind}: {answer.message}", answer.kind.value
            break
        checked = check(answer)
        if isinstance(checked, Accepted):
            parts = ("llm", "repaired" if turn else "", checked.change)
            accepted, source, reason = checked, ", ".join(filter(None, parts)), ""
            break
        rejected.append(checked.stage)
        reason = f"{checked.stage}: {checked.error}"
        if checked.stage is RejectionStage.REFUSED:
            break
        request = request.followed_by(answer.text[:MAX_QUOTED], repair(checked))
    end = Conclusion(generation, part, source, reason, tuple(rejected), failed)
    calls.transcript.add(end)
    if accepted is None:
        return Conversation(None, end, tuple(prompts))
    return Conversation(accepted.guidance, end, tuple(prompts))


def unasked(calls: Calls, generation: int, part: str, failure: Failure) -> Conversation:
    """The conversation of a question that is not asked because of a failure."""
    reason = f"{failure.kind}: {failure.message}"
    end = Conclusion(generation, part, "fallback", reason, (), failure.kind.value)
    calls.transcript.add(end)
    return Conversation(None, end)


def in_thread(work: Callable[[], T]) -> Future[T]:
    """Starts a function in a daemon thread, which does not keep the process alive."""
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # raised again by `result`
            future.set_exception(error)

    Thread(target=run, name="tree", daemon=True).start()
    return future
