"""The MLflow tracker: copies a run's folder to MLflow in a thread, during the run.

Importing MLflow takes seconds, and its server may not answer. The run never waits for either before
its end. All runs of a process share one thread, a daemon, so that no server can keep the process
alive; `islandgp sync` sends what it has not sent.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from functools import cache
from pathlib import Path
from queue import Queue
from threading import Thread
from time import monotonic, sleep
from typing import Final

from islandgp.errors import TrackingError, brief
from islandgp.records.folder import RunFolder, Status
from islandgp.resources import program
from islandgp.tracking.store import MLflowSettings, Store, TrackingStore, check_place, load
from islandgp.tracking.sync import sync
from islandgp.tracking.upload import RunUploader

DEFAULT: Final = ("sqlite:///mlflow.db", "islandgp")
"""Address and experiment in the package's configuration."""

PERIOD: Final = 2.0  # least s between two batches of an unfinished run


MESSAGE_DELAY: Final = 2.0  # s of waiting before the user gets a message
RETRY_DELAY: Final = 1.0  # s before a failed task is repeated

Task = Callable[[], str]
"""Sends records; returns "" or why some of them were not sent. It raises if the store fails."""


class Sender:
    """Executes tasks one after the other in a daemon thread."""

    def __init__(self) -> None:
        self._tasks: Queue[tuple[Task, Future[str]]] = Queue()
        self._progress = monotonic()  # time of the last answer of a store
        Thread(target=self._work, name="mlflow", daemon=True).start()
        self._loaded = self.put(load)

    def put(self, task: Task) -> Future[str]:
        """Queue a task; return immediately."""
        future: Future[str] = Future()
        self._tasks.put((task, future))
        return future

    def alive(self) -> None:
        """A store has answered; tasks call this after each batch of records."""
        self._progress = monotonic()

    def _work(self) -> None:
        while True:
            task, future = self._tasks.get()
            try:
                future.set_result(task())
                self.alive()
            except Exception as error:  # a store may fail in any way, and a folder be damaged
                future.set_exception(error)

    def finish(self, task: Task, patience: float, command: str, *, may_hang: bool) -> str:
        """Execute a task and wait for it; repeat it while it fails. Ctrl-C ends the waiting.

        Args:
            task: to execute.
            patience: s without an answer after which it gives up, >= 0; with 0 it does not wait.
            command: that sends the rest, for the message after MESSAGE_DELAY.
            may_hang: True: the store is a server, which may never answer. For a file, the patience
                counts from its first failure.

        Returns:
            "", or the reason why not everything was sent.
        """
        begin, reason, is_informed = monotonic(), "", False
        future = self.put(task)
        try:
            while True:
                wait([future], min(patience, MESSAGE_DELAY / 4))
                if future.done():
                    try:
                        return future.result()
                    except Exception as error:
                        reason = brief(error)
                    sleep(min(patience, RETRY_DELAY))
                    future = self.put(task)
                if not self._loaded.done() or not (may_hang or reason):
                    self.alive()  # imports and a new SQLite file take long on a busy machine
                if monotonic() - max(begin, self._progress) >= patience:
                    return reason or f"no answer in {patience:g} s"
                if not is_informed and monotonic() - begin >= MESSAGE_DELAY:
                    is_informed = True
                    message = f"sending to MLflow; Ctrl-C stops waiting, `{command}` sends the rest"
                    print(message, file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            return "waiting was interrupted"


@cache
def sender() -> Sender:
    """The sender of this process, started when it is first needed."""
    return Sender()


class MLflow:
    """Copies one run's folder to MLflow."""

    Settings = MLflowSettings

    @classmethod
    def make(cls, settings: MLflowSettings, home: Path) -> MLflow:
        """See `Tracker`."""
        return cls(TrackingStore.of(settings, home), settings.patience)

    @classmethod
    def check(cls, settings: MLflowSettings, home: Path) -> None:
        """See `Tracker`. Raises TrackingError if runs can never be stored at this address."""
        check_place(TrackingStore.of(settings, home))

    def __init__(self, place: TrackingStore, patience: float) -> None:
        """Starts nothing.

        Args:
            place: of the store.
            patience: s that `finish` waits without an answer of the store, >= 0.
        """
        self.place = place
        self.patience = patience
        self._store: Store | None = None  # of the sender's thread
        self._batch: Future[str] | None = None  # the last batch of the unfinished run
        self._due = 0.0  # time of the next one

    def start(self, folder: RunFolder) -> None:
        """See `Tracker`."""
        self._path = folder.path.absolute()
        if not folder.finished():
            self.generation()

    def generation(self) -> None:
        """See `Tracker`."""
        if monotonic() >= self._due and (self._batch is None or self._batch.done()):
            self._due = monotonic() + PERIOD
            self._batch = sender().put(lambda: self._send(Status.RUNNING))

    def _send(self, status: Status) -> str:
        """Send what the store lacks; executed by the sender's thread."""
        if not self._path.is_dir():  # locking it would make it again
            raise TrackingError(f"Expected a run's folder, found no folder {self._path}.")
        store, self._store = self._store or Store(self.place), None  # opened again after an error
        RunUploader(RunFolder(self._path), store, sender().alive, has_own_page=True).send(status)
        self._store = store
        return ""

    def finish(self, status: Status) -> str:
        """See `Tracker`."""
        command = sync_command([self._path], [self.place])
        reason = sender().finish(
            lambda: self._send(status), self.patience, command, may_hang=self.place.file is None
        )
        if not reason:
            ui = " ".join([program(), "ui", *store_options(self.place)])
            return f"MLflow: {self.place.uri}; {ui} shows it"
        return f"MLflow: {self.place.uri} {_not_sent(reason, command)}"


def sync_command(folders: Sequence[Path], places: Sequence[TrackingStore]) -> str:
    """The command that sends the missing records of folders to their stores.

    It names the store, unless there are several: then `sync` finds that of each run.
    """
    words = [program(), "sync", *(shlex.quote(str(folder.absolute())) for folder in folders)]
    return " ".join([*words, *(store_options(places[0]) if len({*places}) == 1 else [])])


def store_options(place: TrackingStore) -> list[str]:
    """The options by which `sync` and `ui` find a store; none for that of the package's files."""
    if (place.configured, place.experiment) == DEFAULT and place.file == Path.cwd() / "mlflow.db":
        return []
    return ["--uri", shlex.quote(place.uri), "--experiment", shlex.quote(place.experiment)]


def _not_sent(reason: str, command: str) -> str:
    return (
        f"has not received all records ({reason}). They are safe on disk; this command sends"
        f" them:\n  {command}"
    )


def send_sweeps(folders: Sequence[Path], trackers: Sequence[MLflow]) -> str:
    """Send the missing records of sweeps and their jobs.

    Args:
        folders: of the sweeps.
        trackers: of the jobs; the folders have no credentials.

    Returns:
        "", or a message with the command that sends the rest.
    """
    places = list(dict.fromkeys(tracker.place for tracker in trackers))
    command = sync_command(folders, places)

    def send() -> str:
        reports = [sync(folder, places=places, alive=sender().alive) for folder in folders]
        failed = {path: error for report in reports for path, error in report.failed.items()}
        return next((f"{path}: {brief(error)}" for path, error in failed.items()), "")

    reason = sender().finish(
        send,
        max(tracker.patience for tracker in trackers),
        command,
        may_hang=any(place.file is None for place in places),
    )
    return f"MLflow {_not_sent(reason, command)}" if reason else ""
