"""Calls: a request goes out, is tried again if that may help, and is written down.

`LiveCalls` asks the network, and what is written down already it does not ask
again. `recorded.RecordedCalls` asks nobody.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Final, Protocol

from islandgp.errors import SupervisionError
from islandgp.seeding import Stream, stream
from islandgp.supervision.llm.attempt import Attempt, Call, Part, Sent
from islandgp.supervision.llm.ledger import Ledger, known_usage
from islandgp.supervision.llm.message import (
    QUOTED,
    Client,
    Failure,
    FailureKind,
    Reply,
    Request,
    Usage,
)
from islandgp.supervision.llm.prices import cost, most_tokens
from islandgp.supervision.llm.retry import RetrySettings, final, wait
from islandgp.supervision.llm.transcript import Transcript

_SLOTS: Final = {"probe": 0, "rate": 1, "tree": 2}  # of Stream.NETWORK


class Calls(Protocol):
    """Whoever answers calls."""

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """The answer to a call, after as many attempts as it takes."""
        ...

    def conclude(self, part: Part) -> None:
        """Takes note of what became of a part of the guidance."""
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
        sleep: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`sleep` and `clock` take the time's place in tests."""
        self.client, self.transcript, self.ledger, self.retry = client, transcript, ledger, retry
        self.seed, self.sleep, self.clock = seed, sleep, clock
        self._closed = False

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """See `Calls`. An answer that is written down for the same request is given again.

        But for a probe's failure: it ended a run that had not begun, and may be mended by now.
        """
        done = [
            a
            for a in self.transcript.of(call)
            if a.request.digest == request.digest
            and (call.part != "probe" or isinstance(a.answer, Reply))
        ]
        rng = stream(
            self.seed,
            Stream.NETWORK,
            generation=call.generation + 1,
            slot=10 * _SLOTS[call.part] + call.turn,
        )
        answer = done[-1].answer if done else None
        number = done[-1].number if done else 0
        while answer is None or not final(answer, number, self.retry):
            waited = 0.0
            if isinstance(answer, Failure):
                waited = wait(answer, number, self.retry, rng)
                self.sleep(waited)
            number += 1
            answer = self._attempt(call, number, request, waited)
        return answer

    def conclude(self, part: Part) -> None:
        """See `Calls`."""
        self.transcript.conclude(part)

    def room_for(self, requests: Sequence[Request], repairs: int) -> bool:
        """See `Calls`: as long as no cap could end one of them.

        Near a cap they are asked one after the other: which of them it ends must not
        depend on which answer comes first.
        """
        attempts, turns = self.retry.attempts, 1 + repairs
        count = attempts * turns * len(requests)
        most = [most_tokens(request, longer=QUOTED * repairs) for request in requests]
        return self.ledger.room_for(
            count,
            Usage(
                input=attempts * turns * sum(u.input for u in most),
                output=attempts * turns * sum(u.output for u in most),
            ),
            seconds=count * (self.retry.deadline + self.retry.longest_wait)
            + count * self.retry.retry_after_most,
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
        if why := self.ledger.over(most):
            answer = Failure(FailureKind.BUDGET, why)
        else:
            self.transcript.announce(Sent(call, number, most))
            answer = self.client.send(request, seconds=self.retry.deadline)
        self._check_open()
        usage, price = known_usage(answer), self.ledger.price
        attempt = Attempt(
            call=call,
            number=number,
            request=request,
            answer=answer,
            usage=usage,
            at_most=most if usage is None else usage,
            usd=None if usage is None or price is None else cost(usage, price),
            seconds=round(self.clock() - began, 3),
            waited=round(waited, 3),
            at=at,
        )
        self.transcript.add(attempt)
        return answer

    def _check_open(self) -> None:
        if self._closed:
            raise SupervisionError("The run is over; nobody waits for this answer.")
