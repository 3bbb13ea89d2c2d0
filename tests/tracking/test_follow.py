"""The child beside a run: how long a command waits for it, and how its process ends."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

from islandgp.records.folder import Status
from islandgp.tracking import mlflow
from islandgp.tracking.follow import EventKind, OnEvent, SyncEvent, SyncRequest
from islandgp.tracking.mlflow import MLflow, SyncClient, SyncProcess
from islandgp.tracking.store import Place, Store
from tests.tracking.folders import begun, closed_run, history, place, steps

ONE = SyncRequest("runs/a", (Place("sqlite:///x", None, "e"),), Status.FINISHED)
SENT, DONE = SyncEvent(EventKind.PROGRESS), SyncEvent(EventKind.DONE, "", ONE.folder)
LOADING, READY = SyncEvent(EventKind.PREPARING, "loading MLflow"), SyncEvent(EventKind.PREPARING)
AWAY = SyncEvent(EventKind.TROUBLE, "connection refused", ONE.folder)


@dataclass
class Clock:
    """A clock and a condition in which events come at times of a script."""

    script: list[tuple[float, SyncEvent]]  # s after the one before, and the event
    client: Any = None
    now: float = 0
    waits: list[float] = field(default_factory=list)

    def __enter__(self) -> None: ...

    def __exit__(self, *error: object) -> None: ...

    def notify_all(self) -> None: ...

    def wait(self, seconds: float) -> None:
        """Time passes until the next event, or as long as is given."""
        after, event = self.script[0] if self.script else (float("inf"), SENT)
        self.now += min(after, seconds)
        if after <= seconds:
            del self.script[0]
            self.client._on_event(event)
        elif self.script:
            self.script[0] = (after - seconds, event)


class Silent:
    """A worker without events."""

    def __init__(self, _: OnEvent) -> None: ...

    def put(self, request: SyncRequest) -> None:
        """See `SyncWorker`."""

    def close(self) -> None:
        """See `SyncWorker`."""


def waited(monkeypatch: pytest.MonkeyPatch, script: Sequence[tuple[float, SyncEvent]]) -> Clock:
    """A clock that is set to 0, with a client whose requests are carried out by the script."""
    clock = Clock(list(script))
    monkeypatch.setattr(mlflow, "monotonic", lambda: clock.now)
    clock.client = SyncClient(Silent)
    clock.client._changed = clock
    return clock


@pytest.mark.parametrize(
    ("script", "reason", "seconds"),
    [
        pytest.param([(1, READY), (1, DONE)], "", 2, id="at-once"),
        pytest.param([(1, LOADING), (90, READY), (15, DONE)], "", 106, id="slow-machine"),
        pytest.param([(1, READY), *[(15, SENT)] * 9, (9, DONE)], "", 145, id="records-flow"),
        pytest.param([(1, READY)], "no answer in 20 s", 21, id="silence"),
        pytest.param([(1, READY), (15, SENT)], "no answer in 20 s", 36, id="silence-half-way"),
        pytest.param([(1, READY), *[(2, AWAY)] * 50], "connection refused", 21, id="away"),
        pytest.param([(1, LOADING)], "no answer in 20 s", 601, id="it-never-loads"),
        pytest.param([(1, AWAY), (5, DONE)], "", 6, id="back-again"),
    ],
)
def test_how_long_the_end_of_a_run_waits(
    script: list[tuple[float, SyncEvent]],
    reason: str,
    seconds: float,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """As long as MLflow is loaded, a store made or records arrive; and else the patience."""
    clock = waited(monkeypatch, script)
    assert clock.client.wait([ONE], 20, "sqlite:///x") == reason
    assert clock.now == seconds
    assert capsys.readouterr().err.count("Ctrl-C leaves") == (seconds > 2)


@pytest.mark.parametrize(
    ("script", "grace", "seconds"),
    [
        pytest.param([(1, READY), (0.5, SENT), (9, DONE)], 2, 1.5, id="answer"),
        pytest.param([(1, LOADING), (9, READY)], 2, 2, id="slow-machine"),
        pytest.param([(1, AWAY), (5, SENT), (9, DONE)], 2, 6, id="back-again"),
        pytest.param([(1, READY), (9, SENT), (9, DONE)], float("inf"), 10, id="server"),
    ],
)
def test_how_long_a_command_waits_that_leaves(
    script: list[tuple[float, SyncEvent]],
    grace: float,
    seconds: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Until the store has answered, or for the grace if nothing has failed."""
    clock = waited(monkeypatch, script)
    assert clock.client.wait([ONE], 20, "sqlite:///x", leave_after=grace) == ""
    assert clock.now == seconds


def test_without_patience_nothing_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even for a store that is being made: a sweep's end does that."""
    clock = waited(monkeypatch, [(1, LOADING)])
    assert clock.client.wait([ONE], 0, "sqlite:///x") == "no answer in 0 s"
    assert clock.now == 0


def test_ctrl_c_ends_the_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run is over: it is no error, and the records can be sent later."""
    clock = waited(monkeypatch, [])

    def pressed(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(clock, "wait", pressed)
    assert "waiting was interrupted" in clock.client.wait([ONE], 20, "sqlite:///x")


@pytest.mark.slow
def test_a_store_that_is_slow_to_be_made_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five minutes, with a patience of one: it is made only after a message to the user."""
    condition = mlflow.Condition()
    messages: list[str] = []

    def five_minutes_pass(*arguments: Any, **_: Any) -> None:
        with condition:
            messages.append(str(arguments[0]))
            condition.notify()

    monkeypatch.setattr(mlflow, "monotonic", lambda: monotonic() + 300 * len(messages))

    def store(store_place: Any, preparing: Any) -> Store:
        preparing("making the store")
        with condition:
            assert condition.wait_for(lambda: bool(messages), 60)
        return Store(store_place, preparing)

    monkeypatch.setattr("islandgp.tracking.follow.Store", store)
    monkeypatch.setattr("builtins.print", five_minutes_pass)
    monkeypatch.setattr(mlflow, "MESSAGE_DELAY", 0.2)
    folder = closed_run(tmp_path / "runs/a/one", tmp_path)
    follows = MLflow(place(tmp_path), 60)
    follows.start(folder)
    assert follows.finish(Status.FINISHED).endswith("ui shows it")
    (line,) = messages
    assert "making the store; Ctrl-C leaves" in line


def worker_process() -> Any:
    """The child of this process's runs."""
    worker: Any = mlflow.shared_client().worker
    return worker.process


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_the_process_sends_a_run_and_ends_with_its_input(
    home: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All generations are there in spite of Ctrl-C in the terminal; no process stays."""
    monkeypatch.setattr(MLflow, "worker", SyncProcess)
    folder = begun(home / "runs/a/one", home)
    follows = MLflow(place(home), 120)
    follows.start(folder)
    for step in steps()[:3]:
        folder.append(step)
        follows.generation()
    assert follows.finish(Status.KILLED).endswith("ui shows it")
    folder.close()
    (run,) = store.client.search_runs([store.experiment])
    assert run.info.status == "KILLED"
    assert [step for step, _ in history(store, run.info.run_id)] == [0, 1, 2]
    process = worker_process()
    assert os.getpgid(process.pid) != os.getpgid(0)  # Ctrl-C in a terminal does not reach it
    process.stdin.close()
    assert process.wait(60) == 0


@pytest.mark.slow
def test_a_process_that_was_killed_is_replaced(
    home: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the run's end, once: all records are there."""
    monkeypatch.setattr(MLflow, "worker", SyncProcess)
    folder = begun(home / "runs/a/one", home)
    follows = MLflow(place(home), 120)
    follows.start(folder)
    for step in steps()[:3]:
        folder.append(step)
    client = mlflow.shared_client()
    os.kill(worker_process().pid, signal.SIGKILL)
    with client._changed:
        assert client._changed.wait_for(lambda: client.ended, 60)
    assert follows.finish(Status.KILLED).endswith("ui shows it")
    folder.close()
    (run,) = store.client.search_runs([store.experiment])
    assert [step for step, _ in history(store, run.info.run_id)] == [0, 1, 2]


FAILS = "def fail(*_): raise ImportError('no such library')\n"
FOLLOW = "from islandgp.tracking import follow\n"


@pytest.mark.parametrize(
    "program",
    [
        pytest.param(f"{FAILS}fail()", id="at its start"),
        pytest.param(f"{FOLLOW}{FAILS}follow.load_alone = fail\nfollow.serve()", id="MLflow"),
        pytest.param(f"{FOLLOW}{FAILS}follow.trust = fail\nfollow.serve()", id="at a request"),
    ],
)
def test_a_process_that_fails_ends_and_reports_the_reason(
    program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the last line of its traceback."""
    monkeypatch.setattr(mlflow, "COMMAND", (sys.executable, "-c", program))
    monkeypatch.setattr(MLflow, "worker", SyncProcess)
    folder = begun(tmp_path / "runs/a/one", tmp_path)
    follows = MLflow(place(tmp_path), 120)
    follows.start(folder)
    message = follows.finish(Status.KILLED)
    folder.close()
    assert "the process that sends them ended: ImportError: no such library" in message
    assert f"islandgp sync {folder.path}" in message
