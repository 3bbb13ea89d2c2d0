"""The one retry layer: which failures are tried again, how often, and after how long."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from islandgp.supervision.llm.budget import Ledger
from islandgp.supervision.llm.calls import LiveCalls, final, wait
from islandgp.supervision.llm.message import TRANSIENT, Failure, FailureKind, Reply, Request, Usage
from islandgp.supervision.llm.settings import Caps, RetrySettings
from islandgp.supervision.llm.transcript import Call, Transcript
from tests.llm.samples import FakeClient, failed, reply_of

RETRIES = RetrySettings(attempts=3, deadline=30, first_wait=1, longest_wait=20, retry_after_most=30)
ASK = Request("m", "s", ("u",), 100)
CALL = Call(4, "rate", 0)
NO_CAPS = Caps(requests=None, input_tokens=None, output_tokens=None, usd=None, seconds=None)


@dataclass
class Clock:
    """A clock that only sleeping moves."""

    now: float = 0.0
    slept: list[float] = field(default_factory=list)

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds

    def __call__(self) -> float:
        return self.now


def calls(
    client: FakeClient, retries: RetrySettings = RETRIES, seed: int = 0
) -> tuple[LiveCalls, Clock]:
    transcript, clock = Transcript(None), Clock()
    ledger = Ledger(transcript, None, NO_CAPS)
    live = LiveCalls(client, transcript, ledger, retries, seed=seed, sleep=clock.sleep, clock=clock)
    return live, clock


@pytest.mark.parametrize("kind", sorted(TRANSIENT))
def test_a_transient_failure_is_tried_three_times(kind: FailureKind) -> None:
    """Section 2.4.5: up to three attempts; the last failure is the answer."""
    client = FakeClient([failed(kind)] * 5)
    failure = calls(client)[0].ask(CALL, ASK)
    assert isinstance(failure, Failure)
    assert failure.kind is kind
    assert failure.message.startswith(f"a made-up {kind} failure")
    assert len(client.requests) == 3


def test_an_answer_that_is_too_late_names_the_setting() -> None:
    """The deadline of an attempt, or the cap that left less than that."""
    live, _ = calls(FakeClient([failed(FailureKind.TIMEOUT)] * 3))
    failure = live.ask(CALL, ASK)
    assert isinstance(failure, Failure)
    assert "; raise supervisor.policy.retry.deadline, a model that thinks may" in failure.message
    live, clock = calls(FakeClient([failed(FailureKind.TIMEOUT)] * 3))
    live.ledger.caps = NO_CAPS.model_copy(update={"seconds": 7})
    live.client.script = lambda *_: clock.sleep(7) or failed(FailureKind.TIMEOUT)  # type: ignore[attr-defined, func-returns-value]
    live.ask(CALL, ASK)
    first = live.transcript.attempts[0].answer
    assert isinstance(first, Failure)
    assert "; raise supervisor.policy.caps.seconds, a model" in first.message


@pytest.mark.parametrize("kind", sorted(set(FailureKind) - TRANSIENT))
def test_a_lasting_failure_is_not_tried_again(kind: FailureKind) -> None:
    """What another attempt cannot mend costs one attempt."""
    client = FakeClient([failed(kind)] * 5)
    calls(client)[0].ask(CALL, ASK)
    assert len(client.requests) == 1


def test_the_first_reply_ends_the_call() -> None:
    """A reply after two failures is the answer; nothing is sent after it."""
    client = FakeClient(
        [failed(FailureKind.SERVER), failed(FailureKind.TIMEOUT), reply_of("yes"), reply_of("no")]
    )
    assert calls(client)[0].ask(CALL, ASK) == reply_of("yes")
    assert len(client.requests) == 3


def test_waits_double_and_have_jitter() -> None:
    """The n-th wait is half to all of first_wait * 2**(n-1), at most longest_wait."""
    rng = np.random.default_rng(0)
    failure = failed(FailureKind.SERVER)
    for attempt, most in ((1, 1), (2, 2), (3, 4), (4, 8), (5, 16), (6, 20), (60, 20)):
        waits = {wait(failure, attempt, RETRIES, rng) for _ in range(50)}
        assert most / 2 <= min(waits) < max(waits) <= most


def test_jitter_comes_from_the_run_s_seed() -> None:
    """The same run waits the same times, another seed others."""

    def slept(seed: int) -> list[float]:
        client = FakeClient([failed(FailureKind.OVERLOADED)] * 3)
        live, clock = calls(client, seed=seed)
        live.ask(CALL, ASK)
        return clock.slept

    assert slept(1) == slept(1)
    assert slept(1) != slept(2)
    assert len(slept(1)) == 2


def test_a_short_retry_after_is_obeyed() -> None:
    """The wait is never shorter than the server asks for."""
    client = FakeClient([failed(FailureKind.RATE_LIMITED, 25), reply_of("yes")])
    live, clock = calls(client)
    assert isinstance(live.ask(CALL, ASK), Reply)
    assert clock.slept == [25]


def test_the_next_call_waits_as_the_server_wished() -> None:
    """A call that ended with a wish of the server leaves it to the call behind it."""
    client = FakeClient(
        [failed(FailureKind.RATE_LIMITED, 25)] * 3 + [reply_of("yes"), reply_of("yes")]
    )
    live, clock = calls(client)
    assert isinstance(live.ask(CALL, ASK), Failure)
    assert clock.slept == [25, 25]
    clock.now += 5
    assert isinstance(live.ask(replace(CALL, generation=5), ASK), Reply)
    assert clock.slept == [25, 25, 20]
    assert isinstance(live.ask(replace(CALL, generation=6), ASK), Reply)
    assert clock.slept == [25, 25, 20]


def test_an_endless_retry_after_ends_the_call_at_once() -> None:
    """Above the cap there is no wait and no further attempt: it would be refused again."""
    client = FakeClient([failed(FailureKind.RATE_LIMITED, 86400)] * 3)
    live, clock = calls(client)
    assert isinstance(live.ask(CALL, ASK), Failure)
    assert len(client.requests) == 1
    assert clock.slept == []


def test_the_cap_itself_is_still_obeyed() -> None:
    """Exactly at the cap the server's wish is granted."""
    at, above = failed(FailureKind.RATE_LIMITED, 30), failed(FailureKind.RATE_LIMITED, 30.1)
    assert not final(at, 1, RETRIES)
    assert final(above, 1, RETRIES)


def test_each_attempt_has_the_same_deadline() -> None:
    """Every attempt gets the 30 s of section 2.4.5."""
    seconds: list[float] = []

    class Watching(FakeClient):
        def send(self, request: Request, *, seconds: float) -> Reply | Failure:
            times.append(seconds)
            return super().send(request, seconds=seconds)

    times = seconds
    calls(Watching([failed(FailureKind.TIMEOUT)] * 3))[0].ask(CALL, ASK)
    assert seconds == [30, 30, 30]


def test_attempts_are_written_down_one_by_one() -> None:
    """The transcript has each attempt with its number, wait and answer."""
    client = FakeClient([failed(FailureKind.CUT), Reply("yes", "end_turn", Usage(7, 8))])
    live, clock = calls(client)
    live.ask(CALL, ASK)
    first, second = live.transcript.attempts
    assert (first.number, first.waited, first.usage) == (1, 0, None)
    assert (second.number, second.usage) == (2, Usage(7, 8))
    assert second.waited == pytest.approx(clock.slept[0], abs=1e-3)


def test_a_call_goes_on_where_a_kill_ended_it() -> None:
    """Attempts that are written down count: after one failure two are left."""
    client = FakeClient([failed(FailureKind.SERVER)] * 9)
    live, _ = calls(client, RetrySettings(**{**RETRIES.model_dump(), "attempts": 1}))
    live.ask(CALL, ASK)
    live.retry = RETRIES
    live.ask(CALL, ASK)
    assert [a.number for a in live.transcript.attempts] == [1, 2, 3]
    live.ask(CALL, ASK)
    assert len(client.requests) == 3


def test_an_answer_that_is_written_down_is_not_asked_for_again() -> None:
    """The same request at the same place of the run is sent once; a different one is sent, too."""
    client = FakeClient([reply_of("one"), reply_of("two")])
    live, _ = calls(client)
    assert live.ask(CALL, ASK) == live.ask(CALL, ASK) == reply_of("one")
    assert live.ask(CALL, ASK.followed_by("one", "again")) == reply_of("two")


def test_the_server_s_header_on_retries_is_obeyed() -> None:
    """It overrides the kind of the failure, in both directions."""
    no = replace(failed(FailureKind.OVERLOADED), should_retry=False)
    yes = replace(failed(FailureKind.REJECTED), should_retry=True)
    for failure, attempts in ((no, 1), (yes, 3)):
        client = FakeClient([failure] * 5)
        calls(client)[0].ask(CALL, ASK)
        assert len(client.requests) == attempts
