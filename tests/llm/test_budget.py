"""Ledger and caps: everything is counted, and no cap is ever passed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

from islandgp.errors import ConfigError
from islandgp.supervision.llm.budget import Ledger
from islandgp.supervision.llm.client import ServerClient
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage
from islandgp.supervision.llm.settings import Caps
from islandgp.supervision.llm.supervisor import LLM
from islandgp.supervision.llm.transcript import Attempt, Call, Sent, Transcript
from tests.composed import composed
from tests.llm.samples import (
    DECISION,
    FakeClient,
    advise,
    answering,
    context,
    failed,
    kind_of,
    settings,
    state,
    supervisor,
)
from tests.llm.server import MessagesServer
from tests.profiles import sweep

REST = (None, 0.0, 0.0, "at")  # of an attempt


def run_of(llm: LLM, generations: int) -> list[str]:
    """The sources of the guidance of so many generations."""
    return [advise(llm, state(g)).source for g in range(generations)]


def test_prices_of_every_model_of_the_sdk_are_known() -> None:
    """Each has a price or is listed as one without."""
    from anthropic.types.model import Model

    table = settings().prices
    named = set(get_args(get_args(Model)[0]))
    assert len(named) > 15
    assert named == set(table.models) | set(table.unknown)
    assert not set(table.models) & set(table.unknown)
    assert set(table.facts) <= named
    assert set(table.aliases.values()) <= set(table.models)


@pytest.mark.parametrize("model", ["claude-fable-5-2", "current-large"])
def test_a_cap_in_dollars_needs_a_known_price(model: str) -> None:
    """A cap in dollars cannot be kept with it, and the error names it."""
    with pytest.raises(ConfigError, match=f"expected a model with a known price, found '{model}'"):
        settings(f"model={model}", "caps.usd=1")


def test_the_ledger_adds_up() -> None:
    """Two questions and a probe, one failure: requests, tokens, dollars and failures."""
    script = answering(rate=lambda n: [failed(FailureKind.SERVER), DECISION][n])
    llm, client = supervisor(script)
    advise(llm)
    spent = llm.spent()
    assert len(client.requests) == 4
    expected = {
        "requests": 4,
        "calls": 3,
        "input_tokens": 3000,
        "output_tokens": 300,
        "failures": 1,
        "failures_server": 1,
        "uncounted_requests": 0,
        "rejections": 0,
        "fallback_rates": 0,
        "fallback_trees": 0,
        "cost_usd": pytest.approx((3000 + 5 * 300) / 1e6),
    }
    assert {name: spent[name] for name in expected} == expected


def test_the_ledger_goes_on_after_a_resumption(tmp_path: Path) -> None:
    """It is a sum over the transcript, so another process has the same sums."""
    first, _ = supervisor(answering(rate={"mutation_rate": 9}), folder=tmp_path)
    run_of(first, 3)
    resumed, client = supervisor(answering(), folder=tmp_path)
    resumed.start()
    assert client.requests == []
    assert resumed.spent() == first.spent()
    assert resumed.spent()["rejected_fields"] == 6
    assert resumed.spent()["fallback_rates"] == 3


@pytest.mark.parametrize(
    ("kind", "usage"),
    [
        (FailureKind.TIMEOUT, None),
        (FailureKind.CUT, None),
        (FailureKind.MALFORMED, None),
        (FailureKind.UNREACHABLE, Usage()),
        (FailureKind.RATE_LIMITED, Usage()),
        (FailureKind.SERVER, Usage()),
        (FailureKind.UNAUTHORISED, Usage()),
        (FailureKind.BUDGET, Usage()),
    ],
)
def test_what_a_failure_may_have_cost(kind: FailureKind, usage: Usage | None) -> None:
    """A refused request is free; one whose answer was lost may have been charged."""
    attempt = Attempt(Call(0, "rate", 0), 1, Request("m", "s", ("u",), 9), Failure(kind, ""), *REST)
    assert attempt.usage == usage


def test_a_connection_that_is_not_made_is_no_request() -> None:
    """Nothing was sent: it is a failure, and takes nothing of the caps but its seconds."""
    plain = answering(tree=failed(FailureKind.UNREACHABLE))
    llm, client = supervisor(plain, "caps.requests=7", "caps.usd=0.2")
    assert run_of(llm, 5) == ["llm and fallback"] * 5
    spent = llm.spent()
    assert spent["requests"] == 6
    assert len(client.requests) == 6 + 5 * 3
    assert spent["uncounted_requests"] == 0
    assert spent["cost_usd"] == spent["cost_usd_at_most"]
    assert spent["failures_unreachable"] == len(client.requests) - 6


def test_what_makes_a_request_longer_is_in_the_bound() -> None:
    """Its schema, and a quoted answer of a byte a token."""
    plain = Request("m", "s", ("u",), 2048)
    for longer in (
        replace(plain, schema={"enum": ["word"] * 3000}),
        replace(plain, turns=("u", "\U00012345" * 500, "u")),
    ):
        assert longer.most_tokens().input - plain.most_tokens().input >= 1999


@pytest.mark.parametrize(
    "value",
    [
        "caps.usd=inf",
        "caps.seconds=inf",
        "caps.usd=-1",
        "caps.requests=0.5",
        "retry.deadline=inf",
        "retry.deadline=1e12",
        "retry.longest_wait=1e12",
        "+prices.models.m={input: inf, output: 1, cache_read: 0, cache_write: 0}",
    ],
)
def test_an_odd_number_is_refused_before_the_run(value: str) -> None:
    """It could not be written down, waited for or multiplied with."""
    with pytest.raises(ConfigError, match=re.escape(value.lstrip("+").partition("=")[0])):
        settings(value)


@pytest.mark.parametrize("cap", [0, 1, 2, 3, 7, 8])
def test_a_cap_on_requests_is_exact(cap: int) -> None:
    """Exactly so many requests are sent; then the fallback goes on to the end."""
    llm, client = supervisor(answering(), f"caps.requests={cap}")
    sources = run_of(llm, 6)
    assert len(client.requests) == cap
    assert len(sources) == 6
    assert sources[-1] == "fallback"


@pytest.mark.parametrize(
    "cap", ["caps.usd=0.05", "caps.input_tokens=30000", "caps.output_tokens=9000"]
)
def test_no_cap_is_passed(cap: str) -> None:
    """With honest counts, lost answers and repairs, the most that may be spent stays below."""
    script = answering(
        rate=lambda n: [DECISION, failed(FailureKind.TIMEOUT), {"mutation_rate": 7}][n % 3]
    )
    llm, _ = supervisor(script, cap)
    assert run_of(llm, 40)[-1] == "fallback"
    assert llm.calls is not None
    most = llm.calls.ledger.most()
    totals = {
        "usd": most.usd,
        "input_tokens": most.input_tokens,
        "output_tokens": most.output_tokens,
    }
    name, _, limit = cap.removeprefix("caps.").partition("=")
    assert float(limit) / 2 < totals[name] <= float(limit)


def test_a_reached_cap_is_recorded_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    """Every generation's notes give the reason of the fallback; the log has it once."""
    llm, _ = supervisor(answering(), "caps.requests=3")
    answers = [advise(llm, state(g)) for g in range(4)]
    assert answers[0].notes["rate"] == "llm"
    for guidance in answers[1:]:
        assert guidance.notes["rate"].startswith("fallback: budget: another request could pass")
        assert guidance.source == "fallback"
        assert guidance.tree is not None
    messages = [r.getMessage() for r in caplog.records if r.name == "islandgp"]
    reason = "another request could pass the cap requests=3"
    assert [message for message in messages if reason in message] == [
        f"Supervision continues with the fallback from generation 1: {reason}"
    ]


def test_an_unknown_price_is_an_error_only_with_a_cap_in_dollars() -> None:
    """Without the cap the dollars are left out of the ledger."""
    llm, _ = supervisor(answering(), "model=some-local-model")
    advise(llm)
    assert "cost_usd" not in llm.spent()
    assert llm.spent()["input_tokens"] == 3000
    with pytest.raises(ConfigError) as excinfo:
        composed(
            "supervisor=llm",
            "supervisor.policy.model=some-local-model",
            "supervisor.policy.caps.usd=1",
        )
    assert "caps.usd: expected a model with a known price, found 'some-local-model'" in str(
        excinfo.value
    )


class Killed(BaseException):
    """The process ends here."""


@pytest.mark.parametrize(
    "every", [5, *(pytest.param(n, marks=pytest.mark.slow) for n in (2, 3, 7, 8, 11))]
)
@sweep(
    ("cap", "name", "most"),
    [
        ("requests", "requests", 4),
        ("output_tokens", "requests", 5),
        ("usd", "cost_usd_at_most", 0.07),
    ],
    quick=1,
)
def test_no_moment_of_a_kill_passes_a_cap(
    tmp_path: Path, cap: str, name: str, most: float, every: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed again and again, before and after each line is written and before each answer."""
    moments, requests = [], []

    def moment() -> None:
        moments.append(1)
        if len(moments) % every == 0:
            raise Killed

    def write(transcript: Transcript, line: Mapping[str, Any]) -> None:
        moment()
        really_write(transcript, line)
        moment()

    def answer(request: Request, n: int) -> Reply | Failure:
        requests.append(request)
        moment()
        return answering(tree=failed(FailureKind.TIMEOUT))(request, n)

    really_write = Transcript._write
    monkeypatch.setattr(Transcript, "_write", write)
    run_context = context(tmp_path, "supervisor.adapt_mutation=false")
    caps = {"requests": 4, "output_tokens": 9000, "usd": 0.07}
    spent = []
    for _ in range(15):
        llm, _ = supervisor(answer, f"caps.{cap}={caps[cap]}", run_context=run_context)
        with suppress(Killed):
            run_of(llm, 8)
        spent.append(llm.spent())
    assert len(requests) <= spent[-1]["requests"]
    assert max(costs[name] for costs in spent) <= most
    assert [costs["requests"] for costs in spent] == sorted(costs["requests"] for costs in spent)


def test_no_number_of_kills_passes_the_cap_on_seconds(tmp_path: Path) -> None:
    """Seconds of a lost request are the most that it can take; the last one gets what is left."""
    allowed: list[float] = []

    class Slow(FakeClient):
        def send(self, request: Request, *, seconds: float) -> Reply | Failure:
            if kind_of(request) == "probe":
                return super().send(request, seconds=seconds)
            allowed.append(seconds)
            raise Killed

    run_context = context(tmp_path, "supervisor.adapt_mutation=false")
    for _ in range(8):
        llm = LLM(settings("caps.seconds=100", "retry.deadline=30"), run_context, Slow(answering()))
        with suppress(Killed):
            run_of(llm, 3)
    assert allowed == pytest.approx([30, 30, 30, 10], abs=1)
    assert "the cap seconds=100 is reached" in advise(llm, state(7)).notes["tree"]


def test_no_wait_passes_the_cap_on_seconds() -> None:
    """Between attempts no longer than there is time left."""
    llm, client = supervisor(
        lambda request, n: failed(FailureKind.SERVER, 25),  # noqa: ARG005
        "caps.seconds=40",
    )
    slept: list[float] = []
    llm.calls.sleep = slept.append
    advise(llm)
    assert slept[:2] == [25, pytest.approx(15, abs=1)]
    assert sum(slept) == pytest.approx(40, abs=1)
    assert len(client.requests) == 2


def test_a_lost_request_counts_as_the_most_it_can_be(tmp_path: Path) -> None:
    """In tokens and dollars, too."""
    transcript = Transcript(tmp_path / "transcript.jsonl")
    call = Call(3, "rate", 0)
    transcript.add(Sent(call, 1, Usage(700, 2048), 0.0))
    reread = Transcript(tmp_path / "transcript.jsonl")
    assert reread.unanswered() == [Sent(call, 1, Usage(700, 2048), 0.0)]
    caps = Caps(requests=None, input_tokens=700, output_tokens=None, usd=None, seconds=None)
    ledger = Ledger(reread, settings().model_copy(update={"caps": caps}))
    assert ledger.totals()["cost_usd_at_most"] == pytest.approx((700 + 5 * 2048) / 1e6)
    assert "input_tokens=700" in ledger.over(Usage(1, 0))


def test_a_server_that_counts_nothing_does_not_escape_the_caps() -> None:
    """What it took is unknown, so it is the most that it can be."""
    with MessagesServer(usage=False) as server:
        policy = settings("caps.output_tokens=9000", f"base_url={server.url}")
        llm = LLM(policy, context(), ServerClient(policy))
        sources = run_of(llm, 12)
        assert len(server.requests) == 9000 // 2048
    assert sources[-1] == "fallback"
    assert llm.spent()["output_tokens"] == 0
    assert llm.spent()["uncounted_requests"] == 4
