"""Commands that end before MLflow has all records: when they may, and that nothing is lost."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from queue import Queue
from time import sleep, time
from typing import Any, ClassVar

import pytest

from islandgp.experiment import run
from islandgp.records.folder import Status
from islandgp.running.app import main
from islandgp.tracking import background, mlflow
from islandgp.tracking.background import (
    left_run,
    lock_note,
    note_of,
    seems_usable,
    store_exists,
    write_note,
)
from islandgp.tracking.follow import (
    Detach,
    EventKind,
    Follower,
    OnEvent,
    SyncEvent,
    SyncRequest,
    message_of,
)
from islandgp.tracking.mlflow import MLflow, SyncProcess, close_client
from islandgp.tracking.store import Place, Store
from islandgp.tracking.sync_state import SyncState, write_state
from tests.running.commands import TINY, fake
from tests.tracking import servers
from tests.tracking.folders import begun, closed_run, finished, history, place, steps

posix = pytest.mark.skipif(os.name != "posix", reason="locks of folders, signals")

ANSWER = SyncEvent(EventKind.PROGRESS)
READY, LOADING = SyncEvent(EventKind.PREPARING), SyncEvent(EventKind.PREPARING, "loading MLflow")
AWAY = SyncEvent(EventKind.TROUBLE, "connection refused", "runs/a/one")
SENDS = "A process sends the last records now"


class Scripted:
    """A worker with these events at its start."""

    events: tuple[SyncEvent, ...] = ()
    workers: ClassVar[list[Scripted]] = []

    def __init__(self, on_event: OnEvent, niceness: int) -> None:
        self.workers.append(self)
        self.messages: list[SyncRequest | Detach] = []
        self.niceness, self._on_event = niceness, on_event
        for event in self.events:
            on_event(event)

    def put(self, message: SyncRequest | Detach) -> None:
        """See `SyncWorker`."""
        self.messages.append(message)

    def close(self) -> None:
        """See `SyncWorker`."""


def ended(
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    *events: SyncEvent,
    store: Place | None = None,
    status: Status = Status.FINISHED,
    single: bool = True,
) -> tuple[str, Scripted]:
    """What is printed at the end of a run that need not wait, and its worker.

    Args:
        home: working folder.
        monkeypatch: of the test.
        events: of the worker.
        store: None: a file.
        status: of the run.
        single: True: the command ends with the run.
    """
    monkeypatch.setattr(Scripted, "events", events)
    monkeypatch.setattr(Scripted, "workers", [])
    monkeypatch.setattr(MLflow, "worker", Scripted)
    monkeypatch.setattr(mlflow, "PREPARATION_LIMIT", 0.01)
    tracker = MLflow(store or place(home), 0.01, background=True)
    if single:
        tracker.allow_background()
    folder = begun(home / "runs/a/one", home)
    tracker.start(folder)
    tracker.generation()
    text = tracker.finish(status)
    folder.close()
    (worker,) = Scripted.workers
    return text, worker


SERVER = Place("http://server:5000", None, "e")


@posix
@pytest.mark.parametrize(
    ("events", "store"),
    [
        pytest.param((), None, id="file"),
        pytest.param((AWAY, ANSWER), SERVER, id="server-back-again"),
    ],
)
def test_a_command_leaves_a_process_that_sends_the_last_records(
    events: tuple[SyncEvent, ...],
    store: Place | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The process is not stopped with the command, whose last line names the remedy.

    For a file it starts at the end of a short run, with the lowest priority.
    """
    text, worker = ended(tmp_path, monkeypatch, *events, store=store)
    path = tmp_path / "runs/a/one"
    assert SENDS in text
    assert f"sync {path}" in text
    note = note_of(tmp_path / "mlflow.db")
    statuses = [message.status for message in worker.messages[:-1]]  # type: ignore[union-attr]
    if store is None:
        assert statuses == [Status.FINISHED]
        assert worker.niceness == 19
        assert note.read_text().strip() == str(path)
    else:
        assert statuses == [Status.RUNNING, Status.FINISHED]
        assert worker.niceness == 5
    assert worker.messages[-1] == Detach(0.01, "" if store else str(note))
    assert mlflow._clients == []


@posix
def test_a_long_run_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MLflow shows it while it runs, from QUIET_PERIOD on."""
    monkeypatch.setattr(mlflow, "QUIET_PERIOD", 0)
    _, worker = ended(tmp_path, monkeypatch, READY, ANSWER)
    requests = [message for message in worker.messages if isinstance(message, SyncRequest)]
    assert [request.status for request in requests] == [Status.RUNNING, Status.FINISHED]
    assert worker.niceness == 19


@posix
@pytest.mark.parametrize(
    ("events", "options"),
    [
        pytest.param((READY, ANSWER), {"single": False}, id="other-runs-follow"),
        pytest.param((READY, ANSWER), {"status": Status.KILLED}, id="stopped"),
        pytest.param((ANSWER, AWAY), {}, id="store-fails"),
        pytest.param((READY,), {"store": SERVER}, id="server-is-silent"),
        pytest.param((ANSWER, LOADING), {"store": SERVER}, id="server-is-lost"),
    ],
)
def test_a_command_waits_if_the_store_may_not_get_the_records(
    events: tuple[SyncEvent, ...],
    options: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also if other runs follow, or the run did not finish."""
    text, _ = ended(tmp_path, monkeypatch, *events, **options)
    assert "has not received all records" in text
    assert SENDS not in text


@pytest.mark.parametrize(
    ("damage", "usable"),
    [
        pytest.param("", True, id="sound"),
        pytest.param("UPDATE experiments SET lifecycle_stage = 'deleted'", False, id="deleted"),
        pytest.param("DROP TABLE experiments", False, id="no-store"),
    ],
)
def test_a_store_is_tested_before_a_command_leaves(
    damage: str, usable: bool, tmp_path: Path
) -> None:
    """A missing store, which is made later, is usable; one that another process locks is not."""
    file = tmp_path / "mlflow.db"
    assert seems_usable(file, "islandgp")
    with closing(sqlite3.connect(file)) as database:
        database.execute("CREATE TABLE experiments (name TEXT, lifecycle_stage TEXT)")
        database.execute("INSERT INTO experiments VALUES ('islandgp', 'active')")
        database.execute(damage)
        database.commit()
        assert seems_usable(file, "islandgp") is usable
        database.execute("BEGIN EXCLUSIVE")
        assert not seems_usable(file, "islandgp")


@posix
def test_a_run_that_a_process_left_is_named_by_the_next_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the process may send, the command waits and says nothing; later it does both, once."""
    note = note_of(tmp_path / "mlflow.db")
    before = closed_run(tmp_path / "runs/a/before", tmp_path).path

    def written(age: float) -> None:
        note.write_text(f"{before}\n")
        os.utime(note, (time() - age, time() - age))

    def next_run(age: float) -> str:
        written(age)
        text, _ = ended(tmp_path, monkeypatch, READY)
        assert SENDS not in text
        close_client()
        return text

    assert "may lack" not in next_run(age=1)
    descriptor = lock_note(note, blocking=True)
    assert "may lack" not in next_run(age=60)
    os.close(descriptor)
    text = next_run(age=60)
    assert "may lack" in text
    assert f"sync {before}" in text
    assert not note.exists()
    state = SyncState("sqlite:///x", "islandgp", "i", "r", done="FINISHED 5")
    write_state(before, state)  # `islandgp sync` was called
    written(age=60)
    assert left_run(note) is None
    assert not note.exists()


@posix
@pytest.mark.parametrize("kind", ["folder", "link", "lost-link", "pipe", "long", "binary", "root"])
def test_another_file_in_place_of_a_note_is_not_used(kind: str, tmp_path: Path) -> None:
    """A command neither fails, waits, names a run nor writes to the file that a link names."""
    note, target = note_of(tmp_path / "mlflow.db"), tmp_path / "target"
    long_ago = time() - 3600
    match kind:
        case "folder":
            note.mkdir()
        case "link":
            target.write_bytes(b"\xff")
            note.symlink_to(target)
        case "lost-link":
            note.symlink_to(target)
        case "pipe":
            os.mkfifo(note)
        case _:
            note.write_bytes({"long": b"/a" * 5_000, "binary": b"/\0\xff", "root": b"/"}[kind])
    os.utime(note, (long_ago, long_ago), follow_symlinks=False)
    assert left_run(note) is None
    assert not store_exists(tmp_path / "mlflow.db")
    assert write_note(note, tmp_path) is (kind != "folder")
    assert not target.exists() or target.read_bytes() == b"\xff"


@posix
def test_a_store_that_a_command_left_to_be_made_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`islandgp ui` works at once after the first run, which makes the store after its end."""
    file = tmp_path / "mlflow.db"
    assert not store_exists(file)
    note_of(file).write_text(str(tmp_path))
    monkeypatch.setattr(background, "sleep", lambda _: file.write_bytes(b"store"))
    assert store_exists(file)


def executed(*messages: SyncRequest | Detach) -> tuple[bool, list[SyncEvent]]:
    """The result and the events of a process that gets these messages; it ends by itself."""
    requests: Queue[SyncRequest | Detach | None] = Queue()
    for message in messages:
        requests.put(message_of(message.to_line()))
    events: list[SyncEvent] = []
    return Follower(events.append).run(requests), events


def test_a_detached_process_ends_with_its_last_request(home: Path, store: Store) -> None:
    """The run is complete in the store."""
    folder = closed_run(home / "runs/a/one", home)
    request = SyncRequest(str(folder.path), (place(home),), Status.FINISHED)
    succeeded, events = executed(request, Detach(20))
    assert succeeded
    assert events[-1] == SyncEvent(EventKind.DONE, "", str(folder.path))
    (run,) = store.client.search_runs([store.experiment])
    assert run.info.status == "FINISHED"
    assert len(history(store, run.info.run_id)) == 5


def test_a_detached_process_gives_up_after_its_patience(tmp_path: Path) -> None:
    """It does not live on because a server is away."""
    folder = closed_run(tmp_path / "runs/a/one", tmp_path)
    with servers.refusing() as uri:
        request = SyncRequest(str(folder.path), (Place(uri, None, "e"),), Status.FINISHED)
        succeeded, events = executed(request, Detach(0))
    assert not succeeded
    assert {event.kind for event in events if event.folder} == {EventKind.TROUBLE}


def test_a_deleted_folder_is_not_made_again(home: Path) -> None:
    """The process that sends its records reports trouble instead, also if it had it open."""
    folder = closed_run(home / "runs/a/one", home)
    events: list[SyncEvent] = []
    follower = Follower(events.append)
    assert follower._carry_out(SyncRequest(str(folder.path), (place(home),), Status.RUNNING))
    shutil.rmtree(home / "runs")
    assert not follower._carry_out(SyncRequest(str(folder.path), (place(home),), Status.FINISHED))
    assert not (home / "runs").exists()
    assert "found no folder" in events[-1].text


@posix
def test_a_process_outlives_its_command_and_its_terminal(
    home: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its input ends, and a signal says that the terminal has closed."""
    processes: list[Any] = []

    def start(on_event: OnEvent, niceness: int) -> SyncProcess:
        processes.append(SyncProcess(on_event, niceness))
        return processes[0]  # type: ignore[no-any-return]

    monkeypatch.setattr(MLflow, "worker", start)
    tracker = MLflow(place(home), 120, background=True)
    tracker.allow_background()
    folder = begun(home / "runs/a/one", home)
    tracker.start(folder)
    for step in steps():
        folder.append(step)
    folder.finish(finished(folder, steps()[-1].champion))
    assert SENDS in tracker.finish(Status.FINISHED)
    folder.close()
    note, process = note_of(home / "mlflow.db"), processes[0].process
    with suppress(BlockingIOError, FileNotFoundError):
        while True:  # the process has not read its last message
            os.close(lock_note(note, blocking=False))
            sleep(0.001)
    process.send_signal(signal.SIGHUP)
    process.stdin.close()
    assert process.wait(60) == 0
    (run,) = store.client.search_runs([store.experiment])
    assert run.info.status == "FINISHED"
    assert [step for step, _ in history(store, run.info.run_id)] == list(range(5))
    assert not note.exists()


def test_only_a_single_run_of_a_command_may_be_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not a run that Python code starts, which may start others."""
    left: list[str] = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(MLflow, "worker", Scripted)
    monkeypatch.setattr(MLflow, "allow_background", lambda self: left.append(self.place.experiment))
    policy = ("tracking.policy.patience=0", "gp.generations=2")
    overrides = (*TINY, *fake("Instant"), "progress=off", *policy)
    assert main([*overrides, "tracking.policy.experiment=single"]) == 0
    run(*overrides, "tracking.policy.experiment=library")
    assert left == ["single"]
