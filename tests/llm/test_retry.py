"""The one retry layer: which failures are tried again, how often, and after how long."""

from __future__ import annotations

from dataclasses import replace

import pytest

from islandgp.supervision.llm.calls import Calls, ask_with_less, supported
from islandgp.supervision.llm.message import TRANSIENT, Failure, FailureKind, Reply, Request, Usage
from islandgp.supervision.llm.settings import RetrySettings
from islandgp.supervision.llm.transcript import Call, Transcript
from tests.llm.samples import FakeClient, failed, reply_of, settings

RETRIES = RetrySettings(attempts=3, deadline=30, first_wait=1, longest_wait=20, retry_after_most=30)
ASK = Request("m", "s", ("u",), 100)
CALL = Call(4, "rate", 0)


def calls(
    client: FakeClient, retries: RetrySettings = RETRIES, seed: int = 0
) -> tuple[Calls, list[float]]:
    """The calls, and the seconds that they sleep."""
    slept: list[float] = []
    policy = settings("caps.seconds=null").model_copy(update={"retry": retries})
    return Calls(client, Transcript(None), policy, seed=seed, sleep=slept.append), slept


@pytest.mark.parametrize("kind", sorted(TRANSIENT))
def test_a_transient_failure_is_tried_three_times(kind: FailureKind) -> None:
    """Section 2.4.5: up to three attempts; the last failure is the answer."""
    client = FakeClient([failed(kind)] * 5)
    failure = calls(client)[0].ask(CALL, ASK)
    assert isinstance(failure, Failure)
    assert failure.kind is kind
    assert failure.message.startswith(f"a made-up {kind} failure")
    assert len(client.requests) == 3


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


def test_jitter_comes_from_the_run_s_seed() -> None:
    """The same run waits the same times, another seed others."""

    def waits(seed: int) -> list[float]:
        client = FakeClient([failed(FailureKind.SERVER)] * 3)
        live, slept = calls(client, seed=seed)
        live.ask(CALL, ASK)
        return slept

    assert waits(1) == waits(1)
    assert waits(1) != waits(2)
    first, second = waits(1)
    assert 0.5 <= first <= 1 <= second <= 2


def test_a_short_retry_after_is_obeyed() -> None:
    """The wait is never shorter than the server asks for."""
    client = FakeClient([failed(FailureKind.RATE_LIMITED, 25), reply_of("yes")])
    live, slept = calls(client)
    assert isinstance(live.ask(CALL, ASK), Reply)
    assert slept == [25]


def test_an_endless_retry_after_ends_the_call_at_once() -> None:
    """Above the cap there is no wait and no further attempt: it would be refused again."""
    client = FakeClient([failed(FailureKind.RATE_LIMITED, 86400)] * 3)
    live, slept = calls(client)
    assert isinstance(live.ask(CALL, ASK), Failure)
    assert len(client.requests) == 1
    assert slept == []


def test_attempts_are_written_down_one_by_one() -> None:
    """The transcript has each attempt with its number, wait and answer."""
    client = FakeClient([failed(FailureKind.CUT), Reply("yes", "end_turn", Usage(7, 8))])
    live, slept = calls(client)
    live.ask(CALL, ASK)
    first, second = live.transcript.attempts
    assert (first.number, first.waited, first.usage) == (1, 0, None)
    assert (second.number, second.usage) == (2, Usage(7, 8))
    assert second.waited == pytest.approx(slept[0], abs=1e-3)


def test_a_call_goes_on_where_a_kill_ended_it() -> None:
    """Attempts that are written down count: after one failure two are left."""
    client = FakeClient([failed(FailureKind.SERVER)] * 9)
    live, _ = calls(client, RetrySettings(**{**RETRIES.model_dump(), "attempts": 1}))
    live.ask(CALL, ASK)
    live.settings = live.settings.model_copy(update={"retry": RETRIES})
    live.ask(CALL, ASK)
    assert [a.number for a in live.transcript.attempts] == [1, 2, 3]
    live.ask(CALL, ASK)
    assert len(client.requests) == 3


def test_a_recorded_answer_is_not_asked_for_again() -> None:
    """The same request at the same place of the run is sent once; a different one is sent, too."""
    client = FakeClient([reply_of("one"), reply_of("two")])
    live, _ = calls(client)
    assert live.ask(CALL, ASK) == live.ask(CALL, ASK) == reply_of("one")
    assert live.ask(CALL, ASK.followed_by("one", "again")) == reply_of("two")


SCHEMA = {"type": "object"}
FULL = replace(ASK, temperature=0.7, schema=SCHEMA, grammar="root")


@pytest.mark.parametrize(
    ("errors", "left"),
    [
        (["temperature: not permitted"], {"schema", "grammar"}),
        (["Unrecognized request argument supplied: grammar"], {"temperature", "schema"}),
        (["structured_outputs?", "response_format?"], {"temperature"}),
        (["no.", "no.", "no."], set()),
        (["no.", "no.", "no.", "no."], None),
    ],
)
def test_a_parameter_that_is_rejected_is_left_out(errors: list[str], left: set[str] | None) -> None:
    """That which the error names, else one after the other, until nothing is left to leave out."""
    replies = [Failure(FailureKind.REJECTED, error) for error in errors]
    live, _ = calls(FakeClient([*replies, reply_of("yes")]))
    sent, answer = ask_with_less(live, CALL, FULL)
    has = {n for n in ("temperature", "schema", "grammar") if getattr(sent, n) is not None}
    assert has == (left or set())
    assert isinstance(answer, Failure) is (left is None)
    if left is not None:  # and it is left out of later generations' questions
        assert supported(FULL, live.transcript, CALL.generation) == FULL
        has.discard("grammar")  # the answer is no JSON
        assert supported(FULL, live.transcript, 9) == FULL.without(
            {"temperature", "schema", "grammar"} - has
        )
