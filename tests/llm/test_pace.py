"""`supervisor.policy.per_minute`: runs on one machine share the limits of an account."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from islandgp.supervision.llm import budget
from islandgp.supervision.llm.budget import wait_for_turn
from islandgp.supervision.llm.message import Request
from islandgp.supervision.llm.settings import LLMSettings, PerMinute
from tests.composed import composed
from tests.llm.faults import Fault
from tests.llm.samples import settings
from tests.llm.server import MessagesServer
from tests.llm.test_whole_run import QUICK, live

ASK = Request("m", "s" * 380, ("u" * 380,), 100)


def account(place: str = "here", **limits: float) -> LLMSettings:
    """A model at a place, with limits and 3.8 characters a token."""
    update = {"base_url": f"http://{place}", "per_minute": PerMinute(**limits)}
    return settings().model_copy(update=update)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the shared file."""
    monkeypatch.setattr(budget, "gettempdir", lambda: str(tmp_path))
    return tmp_path


class Clock:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def wait(self, shared: LLMSettings) -> float:
        return wait_for_turn(shared, ASK, self.sleep, lambda: self.now)

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.mark.usefixtures("folder")
def test_runs_take_turns() -> None:
    """Those of one server; another server is free."""
    clock, one = Clock(), account(requests=60)
    assert [clock.wait(one) for _ in range(3)] == pytest.approx([0, 1, 1])
    assert clock.wait(account("there", requests=60)) == 0
    clock.sleep(10)
    assert clock.wait(one) == 0


@pytest.mark.usefixtures("folder")
def test_tokens_are_shared() -> None:
    """760 characters are 200 tokens; the stricter limit counts."""
    clock, shared = Clock(), account(requests=60, input_tokens=6000)
    assert [clock.wait(shared) for _ in range(3)] == pytest.approx([0, 2, 2])


@pytest.mark.parametrize("content", ["", "later", "nan", "9e99", "-5"])
def test_a_damaged_file_of_limits_is_ignored(folder: Path, content: str) -> None:
    """Its time is not waited for."""
    assert Clock().wait(account(requests=60)) == 0
    (file,) = folder.glob("*.turn")
    file.write_text(content)
    assert Clock().wait(account(requests=60)) == 0


class Strict(MessagesServer):
    """Refuses a request that comes less than 30 ms after the last one."""

    def __init__(self) -> None:
        super().__init__(self._early)
        self.last, self.refused = 0.0, 0

    def _early(self, n: int) -> Fault | None:  # noqa: ARG002 -- a script's signature
        is_early, self.last = time.monotonic() - self.last < 0.03, time.monotonic()
        self.refused += is_early
        return Fault.RETRY_SOON if is_early else None


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_four_runs_lose_no_answer(tmp_path: Path) -> None:
    """Of one server, which refuses what they would send without the limit that they share."""
    retry = "supervisor.policy.retry"
    short = ("gp.generations=4", f"{retry}.attempts=2", f"{retry}.deadline=9")

    def sources(*overrides: str) -> tuple[list[str], int]:
        composed("supervisor=llm", *QUICK, *short, *overrides)  # once, not in four threads
        with Strict() as server, ThreadPoolExecutor(4) as pool:
            folders = [tmp_path / f"{len(overrides)}{k}" for k in range(4)]
            runs = pool.map(lambda folder: live(server, folder, *short, *overrides), folders)
            records = [step.record.guidance for steps in runs for step in steps[:-1]]
        return [g.source for g in records if g is not None], server.refused

    shared, refused = sources("supervisor.policy.per_minute.requests=1000")
    alone, refused_alone = sources()
    assert shared == ["llm"] * 4 * 3
    assert refused <= refused_alone
    assert refused_alone > 0
    assert len(alone) == len(shared)


@pytest.mark.usefixtures("folder")
def test_without_rate_limits_requests_do_not_wait() -> None:
    """The default."""
    clock = Clock()
    assert [clock.wait(settings()) for _ in range(3)] == [0, 0, 0]
