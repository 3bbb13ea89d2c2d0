"""Calls: a request goes out, is tried again if that may help, and is written down.

`LiveCalls` asks the network, and what is written down already it does not ask
again. `supervision.replay.RecordedCalls` reads a transcript.

There is one retry layer: how many attempts, and how long to wait between them (section 2.4.5).
`converse` asks one question with its repairs: where an answer cannot be used, it says what was
wrong, for the model to mend it.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import inf
from threading import Lock, Thread
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.seeding import Stream, stream
from islandgp.supervision.llm.answers import Rejection, RejectionStage
from islandgp.supervision.llm.checks import Check
from islandgp.supervision.llm.ledger import Ledger, known_usage, most_tokens
from islandgp.supervision.llm.message import (
    CHARGED,
    QUOTED,
    TRANSIENT,
    Client,
    Failure,
    FailureKind,
    Reply,
    Request,
    Usage,
)
from islandgp.supervision.llm.settings import Outage, RetrySettings
from islandgp.supervision.llm.transcript import Attempt, Call, Conclusion, Sent, Transcript

T = TypeVar("T")


def final(answer: Reply | Failure, attempt: int, how: RetrySettings) -> bool:
    """Whether a call ends with the answer to attempt number `attempt` (from 1)."""
    if isinstance(answer, Reply) or attempt >= how.attempts:
        return True
    said = answer.should_retry  # by the server
    may_help = answer.kind in TRANSIENT if said is None else said
    return not may_help or (answer.retry_after or 0) > how.retry_after_most


def wait(failure: Failure, attempt: int, how: RetrySettings, rng: np.random.Generator) -> float:
    """Seconds to wait after the failed attempt number `attempt`.

    What the server asks for, else half to all of an exponentially growing time:
    runs of a sweep that fail together do not come back together.
    """
    backoff = min(how.longest_wait, how.first_wait * 2.0 ** (attempt - 1))
    return max(failure.retry_after or 0.0, backoff * float(rng.uniform(0.5, 1)))


_SLOTS: Final = {"probe": 0, "rate": 1, "tree": 2, "edits": 3}  # of Stream.NETWORK


def _slot(part: str) -> int:
    """Of a part of the guidance, or of one of several samples of it, such as `edits 2`."""
    name, _, sample = part.partition(" ")
    return _SLOTS[name] + int(sample or 1) - 1


class Calls(Protocol):
    """What answers calls: the network, or a transcript."""

    transcript: Transcript  # what was asked and answered so far, and what came of it

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """The answer to a call, after as many attempts as it takes."""
        ...

    def room_for(self, requests: Sequence[Request], repairs: int) -> bool:
        """Whether these may be asked at the same time, each with so many repairs."""
        ...


class LiveCalls:
    """Asks a client, within a budget."""

    def __init__(
        self,
        client: Client,
        transcript: Transcript,
        ledger: Ledger,
        retry: RetrySettings,
        *,
        seed: int,
        on_outage: Outage = "fallback",
        useless: int | None = None,
        sleep: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """After `useless` calls in a row that may be charged and brought nothing, none waits.

        `sleep` and `clock` take the time's place in tests.
        """
        self.client, self.transcript, self.ledger, self.retry = client, transcript, ledger, retry
        self.seed, self.on_outage, self.useless = seed, on_outage, useless
        self.sleep, self.clock = sleep, clock
        self._closed = False
        self._sending = Lock()  # between the look at the caps and the note of what is sent
        self._not_before = -inf  # by the clock: when the server lets itself be asked again

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """See `Calls`. An answer that is written down for the same request is given again.

        Raises:
            SupervisionError: no server answers, and an outage is to stop the run.
        """
        done = [a for a in self.transcript.of(call) if a.request.digest == request.digest]
        rng = stream(
            self.seed,
            Stream.NETWORK,
            generation=call.generation + 1,
            slot=10 * _slot(call.part) + call.turn,
        )
        answer = done[-1].answer if done else None
        number = done[-1].number if done else 0
        before = 0  # attempts that do not count any more
        if (
            answer is not None
            and final(answer, number, self.retry)
            and self._forgotten(call, answer)
        ):
            answer, before = None, number
        pause = 0.0
        while True:
            while answer is None or not final(answer, number - before, self.retry):
                if isinstance(answer, Failure):
                    due = wait(answer, number - before, self.retry, rng)
                else:  # what an earlier call was told holds for this one, too
                    due = max(0.0, self._not_before - self.clock())
                due = min(due, max(0.0, self.ledger.seconds_left() - pause))
                if due:
                    self.sleep(due)
                waited, pause = pause + due, 0.0
                number += 1
                answer = self._attempt(call, number, request, waited)
            if not self._is_outage(call, answer):
                return answer
            assert isinstance(answer, Failure)
            pause = self._sit_out(answer)
            answer, before = None, number

    def _forgotten(self, call: Call, answer: Reply | Failure) -> bool:
        """Whether a written answer is asked for again, as it may be mended by now.

        So it is with a failure that ended a run, or kept one from starting.
        """
        if isinstance(answer, Reply) or answer.kind is FailureKind.BUDGET:
            return False
        if call.part == "probe" and (call.generation < 0 or answer.kind not in TRANSIENT):
            return True
        return answer.kind in TRANSIENT and self.on_outage != "fallback"

    def _is_outage(self, call: Call, answer: Reply | Failure) -> bool:
        """Whether no server answers and the fallback must not stand in."""
        if isinstance(answer, Reply) or answer.kind not in TRANSIENT:
            return False
        never_there = call.generation < 0 and answer.kind is FailureKind.UNREACHABLE
        paid = self.on_outage == "wait" and answer.kind in CHARGED and self._is_useless()
        return self.on_outage != "fallback" and not never_there and not paid

    def _is_useless(self) -> bool:
        """Whether the last attempts, as many as `useless` calls make, may all be charged."""
        count = 0
        for attempt in reversed(list(self.transcript.attempts)):
            if isinstance(attempt.answer, Reply):
                break
            count += attempt.answer.kind in CHARGED
        return self.useless is not None and count >= self.useless * self.retry.attempts

    def _sit_out(self, failure: Failure) -> float:
        """Waits for the server; returns for how long, s."""
        if self.on_outage == "stop":
            raise SupervisionError(
                f"Expected an answer of the model, found {failure.kind} ({failure.message}); the"
                " run stops, as supervisor.policy.on_outage=stop says. The same command goes on"
                " once the server answers."
            )
        asked = max(failure.retry_after or 0.0, self.retry.longest_wait)
        pause = min(asked, self.ledger.seconds_left())
        logging.getLogger("islandgp").warning(
            "No answer of the model (%s); the next attempt is in %.0f s (on_outage=wait)",
            failure.message,
            pause,
        )
        self.sleep(pause)
        return pause

    def room_for(self, requests: Sequence[Request], repairs: int) -> bool:
        """See `Calls`: as long as no cap could end one of them.

        Near a cap they are asked one after the other: which of them it ends must not
        depend on which answer comes first. The cap on seconds depends on time in any case; of
        it there must be enough for an attempt at each.
        """
        attempts, turns = self.retry.attempts, 1 + repairs
        count = attempts * turns * len(requests)
        most = [most_tokens(request, longer=QUOTED * repairs) for request in requests]
        return self.ledger.room_for(
            count,
            Usage(
                input=attempts * turns * sum(u.input for u in most),
                output=attempts * turns * sum(u.output for u in most),
                cache_write=attempts * turns * sum(u.cache_write for u in most),
            ),
            seconds=turns * len(requests) * self.retry.deadline,
        )

    def close(self) -> None:
        """Ends a call that is under way in another thread: it leaves no trace in the record.

        A run that goes on later makes the attempt again.
        """
        self._closed = True

    def _attempt(self, call: Call, number: int, request: Request, waited: float) -> Reply | Failure:
        self._check_open()
        most = most_tokens(request)
        self.client.open()
        at, began = datetime.now(UTC).isoformat(timespec="milliseconds"), self.clock()
        answer: Reply | Failure
        with self._sending:
            seconds = min(self.retry.deadline, self.ledger.seconds_left() - waited)
            if not (why := self.ledger.reserve(most, waited)):
                self.transcript.add(Sent(call, number, most, round(waited + seconds, 3)))
        if why:
            answer = Failure(FailureKind.BUDGET, why)
        else:
            answer = self._told(self.client.send(request, seconds=seconds), seconds)
        asked = answer.retry_after if isinstance(answer, Failure) else None
        if asked is not None and asked <= self.retry.retry_after_most:
            self._not_before = self.clock() + asked
        self._check_open()
        usage = known_usage(answer)
        attempt = Attempt(
            call=call,
            number=number,
            request=request,
            answer=answer,
            usage=usage,
            at_most=most if usage is None else usage,
            usd=None if usage is None else self.ledger.usd(usage, request.model),
            seconds=round(self.clock() - began, 3),
            waited=round(waited, 3),
            at=at,
        )
        self.transcript.add(attempt)
        if not why:
            self.ledger.settle(attempt, most)
        return answer

    def _told(self, answer: Reply | Failure, seconds: float) -> Reply | Failure:
        """The answer; one that was too late with the setting that gives it more time."""
        if isinstance(answer, Reply) or answer.kind is not FailureKind.TIMEOUT:
            return answer
        short = seconds < self.retry.deadline
        setting = "caps.seconds" if short else "retry.deadline"
        return replace(
            answer,
            message=f"{answer.message}; raise supervisor.policy.{setting}, a model that thinks may"
            " need minutes",
        )

    def _check_open(self) -> None:
        if self._closed:
            raise SupervisionError("The run is over; nobody waits for this answer.")


@dataclass(frozen=True, slots=True)
class Conversation(Generic[T]):
    """A question with its repairs, and the result."""

    value: T | None  # None: no usable answer
    end: Conclusion  # as the transcript keeps it
    prompts: tuple[str, ...] = ()  # SHA-256 of each rendered prompt, hexadecimal
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
    value, source, why, failed = None, "fallback", "", ""
    for turn in range(1 + repairs):
        prompts.append(request.prompt_digest)
        answer = calls.ask(Call(generation, part, turn), request)
        if isinstance(answer, Failure):
            why, failed = f"{answer.kind}: {answer.message}", answer.kind.value
            break
        found = check(answer)
        if not isinstance(found, Rejection):
            words = ("llm", "repaired" if turn else "", found.change)
            value, source, why = found.value, ", ".join(word for word in words if word), ""
            break
        rejected.append(found.stage)
        why = f"{found.stage}: {found.error}"
        if found.stage is RejectionStage.REFUSED:
            break
        request = request.followed_by(answer.text[:QUOTED], repair(found))
    end = Conclusion(generation, part, source, why, tuple(rejected), failed)
    calls.transcript.add(end)
    return Conversation(value, end, tuple(prompts))


def unasked(calls: Calls, generation: int, part: str, why: Failure) -> Conversation[Any]:
    """A question that is not asked, and why."""
    said = f"{why.kind}: {why.message}"
    end = Conclusion(generation, part, "fallback", said, (), why.kind.value)
    calls.transcript.add(end)
    return Conversation(None, end)


def in_thread(work: Callable[[], T]) -> Future[T]:
    """Start a function in a daemon thread, which does not keep the process from ending."""
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # raised again where the result is fetched
            future.set_exception(error)

    Thread(target=run, name="tree", daemon=True).start()
    return future
