"""`supervisor.policy.per_minute`: runs on one machine share the limits of an account."""

from __future__ import annotations

import time
from pathlib import Path
from threading import Thread

import pytest

from islandgp.supervision.llm.budget import Pace
from islandgp.supervision.llm.calls import LiveCalls
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request
from islandgp.supervision.llm.settings import PerMinute
from islandgp.supervision.llm.transcript import Call, Transcript
from tests.llm.samples import USAGE, settings

ASK = Request("m", "s" * 380, ("u" * 380,), 100)


def pace(folder: Path, place: str = "here", **limits: float) -> Pace:
    return Pace(PerMinute(**limits), place, folder, 3.8)


class Clock:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def wait(self, shared: Pace) -> float:
        return shared.wait(ASK, self.sleep, lambda: self.now)

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_runs_take_turns(tmp_path: Path) -> None:
    """Two objects, as of two processes, share the turns of one server; another server is free."""
    clock, one, two = Clock(), pace(tmp_path, requests=60), pace(tmp_path, requests=60)
    assert [clock.wait(p) for p in (one, two, one)] == pytest.approx([0, 1, 1])
    assert clock.wait(pace(tmp_path, "there", requests=60)) == 0
    clock.sleep(10)
    assert clock.wait(one) == 0


def test_tokens_are_shared(tmp_path: Path) -> None:
    """760 characters are 200 tokens; the stricter limit counts."""
    clock, shared = Clock(), pace(tmp_path, requests=60, input_tokens=6000)
    assert [clock.wait(shared) for _ in range(3)] == pytest.approx([0, 2, 2])


@pytest.mark.parametrize("content", ["", "later", "nan", "9e99", "-5"])
def test_a_damaged_file_stops_nobody(tmp_path: Path, content: str) -> None:
    """Its time is not waited for."""
    shared = pace(tmp_path, requests=60)
    shared.path.write_text(content)
    assert Clock().wait(shared) == 0


class Strict:
    """Refuses a request that comes less than 50 ms after the last one."""

    def __init__(self) -> None:
        self.last, self.refused = 0.0, 0

    def open(self) -> None: ...

    def close(self) -> None: ...

    def send(self, request: Request, *, seconds: float) -> Reply | Failure:  # noqa: ARG002
        early, self.last = time.time() - self.last < 0.05, time.time()
        self.refused += early
        return Failure(FailureKind.RATE_LIMITED, "429") if early else Reply("", "end_turn", USAGE)


def test_four_runs_lose_no_answer(tmp_path: Path) -> None:
    """Of a server that is stricter than they are together."""
    server = Strict()
    policy = settings("retry.attempts=1")
    answers: list[Reply | Failure] = []

    def run() -> None:
        calls = LiveCalls(server, Transcript(None), policy, seed=0)
        calls.pace = pace(tmp_path, requests=400)
        answers.extend(calls.ask(Call(g, "rate", 0), ASK) for g in range(2))

    threads = [Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 8
    assert server.refused == 0


def test_without_limits_nobody_waits() -> None:
    """The default."""
    assert Pace.of(settings()) is None
    assert Pace.of(settings("per_minute.requests=50")) is not None
