"""Calls: requests with retries, recorded in the transcript.

A call that is in the transcript is answered from there, so a resumed run asks nothing twice, and a
replay nothing at all.

This is the only layer with retries (section 2.4.5). `converse` sends a question and, if the answer
is rejected, repair turns that quote the error. `supported` and `ask_with_less` find out what a
server accepts: optional parameters that it rejects are left out.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from itertools import zip_longest
from typing import Final

import numpy as np

from islandgp.errors import SupervisionError
from islandgp.seeding import Stream, stream
from islandgp.supervision.base import Guidance
from islandgp.supervision.llm.answers import Check, Rejection, RejectionStage
from islandgp.supervision.llm.budget import Ledger, cost, wait_for_turn
from islandgp.supervision.llm.message import (
    HOPELESS,
    MAX_QUOTED,
    TRANSIENT,
    Client,
    Failure,
    FailureKind,
    Reply,
    Request,
)
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.transcript import Attempt, Call, Conclusion, Sent, Transcript

SLOTS: Final = {"probe": 0, "rate": 1, "tree": 2, "edits": 3}  # of Stream.NETWORK
OPTIONAL: Final = {
    "temperature": r"temperature|sampling|top[_ ][pk]\b",
    "grammar": r"grammar|structured_outputs",
    "schema": r"output_config|output_format|schema|structured|json|response_format",
}
"""Parameters of requests that a server may reject, with patterns of their names in its errors."""


@dataclass
class Calls:
    """Answers calls by a client, within the caps, or from the transcript."""

    client: Client | None  # makes the attempts. None: the transcript is fixed and has all answers.
    transcript: Transcript  # of the run; once it is fixed, nothing is sent any more
    settings: LLMSettings  # of the model: caps, attempts, waiting times and turns with other runs
    seed: int  # of the run, for the jitter of waiting times
    sleep: Callable[[float], None] = time.sleep

    @property
    def ledger(self) -> Ledger:
        """The costs of the run."""
        return Ledger(self.transcript, self.settings)

    def ask(self, call: Call, request: Request) -> Reply | Failure:
        """The answer to a call after all attempts.

        An answer in the transcript to the same request is used again.

        Raises:
            SupervisionError: no answer, and `on_outage` is "stop"; or the transcript is fixed, and
                has no answer or one to another request.
        """
        done = [a for a in self.transcript.of(call) if a.request.digest == request.digest]
        slot = 10 * SLOTS[call.part] + call.turn
        rng = stream(self.seed, Stream.NETWORK, generation=call.generation + 1, slot=slot)
        answer, number = (done[-1].answer, done[-1].number) if done else (None, 0)
        if isinstance(answer, Failure) and self._stops(call, answer):
            answer, number = None, 0  # it stopped the run, or kept it from starting
        while answer is None or not self._is_last(answer, number):
            if self.transcript.fixed:
                raise _not_recorded(self.transcript, call, request)
            waited = 0.0
            if isinstance(answer, Failure):
                waited = min(self._delay(answer, number, rng), self.ledger.seconds_left())
                self.sleep(waited)
            waited += wait_for_turn(self.settings, request)
            number += 1
            answer = self._attempt(call, number, request, waited)
        if isinstance(answer, Failure) and call.part != "probe" and self._stops(call, answer):
            raise SupervisionError(
                f"Expected an answer of the model {request.model}, found {answer.kind}"
                f" ({answer.message}); the run stops (supervisor.policy.on_outage=stop)."
                " The same command continues it once the server answers."
            )
        return answer

    def _is_last(self, answer: Reply | Failure, attempt: int) -> bool:
        """True if no attempt follows: after a reply, a lasting failure, or the last attempt."""
        if isinstance(answer, Reply) or answer.kind not in TRANSIENT:
            return True
        retry = self.settings.retry
        return attempt >= retry.attempts or (answer.retry_after or 0) > retry.retry_after_most

    def _delay(self, failure: Failure, attempt: int, rng: np.random.Generator) -> float:
        """Seconds to wait after the failed attempt number `attempt` (from 1).

        At least what the server requests; otherwise exponential backoff times a factor in [0.5, 1],
        so that the runs of a sweep do not retry at the same time.
        """
        retry = self.settings.retry
        backoff = min(retry.longest_wait, retry.first_wait * 2.0 ** (attempt - 1))
        return max(failure.retry_after or 0.0, backoff * float(rng.uniform(0.5, 1)))

    def _stops(self, call: Call, failure: Failure) -> bool:
        """True if a failure stops the run, or keeps it from starting."""
        if call.part == "probe":
            return failure.kind is not FailureKind.BUDGET
        return self.settings.on_outage == "stop" and failure.kind in HOPELESS | TRANSIENT

    def _attempt(self, call: Call, number: int, request: Request, waited: float) -> Reply | Failure:
        assert self.client is not None
        settings, bound = self.settings, request.most_tokens()
        at, began = datetime.now(UTC).isoformat(timespec="milliseconds"), time.monotonic()
        seconds = min(settings.deadline, self.ledger.seconds_left() - waited)
        answer: Reply | Failure
        if reason := self.ledger.over(bound, waited):
            answer = Failure(FailureKind.BUDGET, reason)
        else:
            self.transcript.add(Sent(call, number, bound, round(waited + seconds, 3)))
            answer = self.client.send(request, seconds=seconds)
        usd, took = None, round(time.monotonic() - began, 3)
        attempt = Attempt(call, number, request, answer, usd, took, round(waited, 3), at)
        if settings.price is not None and attempt.usage is not None:
            attempt = replace(attempt, usd=cost(attempt.usage, settings.price))
        self.transcript.add(attempt)
        return answer


def _not_recorded(transcript: Transcript, call: Call, request: Request) -> SupervisionError:
    """The error for a call that a fixed transcript cannot answer."""
    name, done = transcript.path or "the transcript", transcript.of(call)
    if not done or done[-1].request.digest == request.digest:
        return SupervisionError(
            f"Expected an answer in {name} for the {call}, found none: the recorded run"
            " ended earlier, or made fewer requests."
        )
    lines = zip_longest(_lines(done[-1].request), _lines(request), fillvalue="")
    recorded, now = next((a, b) for a, b in lines if a != b)
    return SupervisionError(
        f"Expected the recorded request in {name} for the {call}, found another one; the first"
        f" difference:\n-{recorded}\n+{now}\nA replay needs the code, the prompts, the"
        " configuration and the seed of the recorded run, and its answers as they were."
    )


def _lines(request: Request) -> list[str]:
    """A request as lines that can be compared."""
    plain = asdict(request)
    texts = [plain.pop("system"), *plain.pop("turns")]
    settings = [f"{key}: {json.dumps(value)}" for key, value in plain.items()]
    return [*settings, *(line for text in texts for line in text.splitlines())]


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


Answer = tuple[Guidance | None, Conclusion]
"""The guidance for a part, None without a usable answer; and how it came about."""


def converse(
    calls: Calls, questions: Questions, call: Call, request: Request, check: Check
) -> Answer:
    """Asks a question, with repair turns if the answer is rejected.

    Args:
        calls: to make the calls with.
        questions: have the text of a repair turn.
        call: of the question.
        request: the question.
        check: accepts or rejects an answer.

    Returns:
        The guidance and the conclusion, which is added to the transcript.
    """
    rejected: list[RejectionStage] = []
    guidance, source, reason, failed = None, "fallback", "", ""
    request = supported(request, calls.transcript, call.generation)
    for turn in range(1 + calls.settings.repairs):
        request, answer = ask_with_less(calls, replace(call, turn=turn), request)
        if isinstance(answer, Failure):
            reason, failed = f"{answer.kind}: {answer.message}", answer.kind.value
            break
        try:
            accepted = check(answer)
        except Rejection as rejection:
            rejected.append(rejection.stage)
            reason = f"{rejection.stage}: {rejection.error}"
            if rejection.stage is RejectionStage.REFUSED:
                break
            request = request.followed_by(answer.text[:MAX_QUOTED], questions.repair(rejection))
        else:
            parts = ("llm", "repaired" if turn else "", accepted.change)
            guidance, source, reason = accepted.guidance, ", ".join(filter(None, parts)), ""
            break
    end = Conclusion(call.generation, call.part, source, reason, tuple(rejected), failed)
    calls.transcript.add(end)
    return guidance, end
