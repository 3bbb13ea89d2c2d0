"""MLflow as a run's tracker: a child process sends the run's folder during evolution.

Loading MLflow takes seconds and its server may be away, so the process that evolves does neither.
"""

from __future__ import annotations

import atexit
import json
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from enum import Enum, auto
from pathlib import Path
from threading import Condition, Thread
from time import monotonic
from typing import ClassVar, Final, Protocol

from islandgp.records.folder import RunFolder, Status
from islandgp.resources import program
from islandgp.tracking.follow import EventKind, OnEvent, SyncEvent, SyncRequest
from islandgp.tracking.store import MLflowSettings, Place, check_place

PREPARATION: Final = 600.0  # s that loading MLflow or making a store may take
SILENT: Final = 2.0  # s of waiting before the user gets a message
COMMAND: Final = (sys.executable, "-P", "-m", "islandgp.tracking.follow")


class SyncWorker(Protocol):
    """Interface of what carries out requests (a subprocess; a thread in tests)."""

    def put(self, request: SyncRequest) -> None:
        """Hand over a request; return at once."""
        ...

    def close(self) -> None:
        """End the worker, if possible in the middle of a request."""
        ...


class SyncProcess:
    """A child that carries out requests."""

    def __init__(self, on_event: OnEvent) -> None:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 -- it lives as long as the child
        self.process = subprocess.Popen(
            COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            # The child finds the modules that this process finds.
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))},
            # Ctrl-C is this process's to handle. The session stays the same: Linux weighs niceness
            # within a session only.
            process_group=0,
        )
        self._listener = Thread(target=self._listen, args=(on_event,), daemon=True)
        self._listener.start()

    def put(self, request: SyncRequest) -> None:
        """See `SyncWorker`."""
        assert self.process.stdin is not None
        with suppress(OSError, ValueError):  # the child has ended: `_listen` reports it
            self.process.stdin.write(request.to_line())
            self.process.stdin.flush()

    def _listen(self, on_event: OnEvent) -> None:
        assert self.process.stdout is not None
        with suppress(ValueError), self.process.stdout as lines:  # a line of a killed child is cut
            for line in lines:
                event = json.loads(line)
                on_event(SyncEvent(**{**event, "kind": EventKind(event["kind"])}))
        self.process.wait()
        with self._errors:
            self._errors.seek(0)
            errors = self._errors.read().decode(errors="replace").strip().splitlines()
        why = errors[-1] if errors else f"exit code {self.process.returncode}"
        on_event(SyncEvent(EventKind.TROUBLE, f"the process that sends them ended: {why}"))

    def close(self) -> None:
        """See `SyncWorker`."""
        assert self.process.stdin is not None
        self.process.kill()
        self._listener.join()
        with suppress(OSError):  # what the child has not read
            self.process.stdin.close()


class WorkerState(Enum):
    """What a worker does, as far as its events show."""

    PREPARING = auto()  # loads MLflow or makes a store: no event for up to PREPARATION seconds
    SENDING = auto()  # sends records: the next event may come any moment


class SyncClient:
    """Makes requests of a worker, and waits for them as long as there is a reason to."""

    def __init__(self, start: Callable[[OnEvent], SyncWorker]) -> None:
        """`start` starts the worker."""
        self._changed = Condition()
        self._state = WorkerState.PREPARING
        self._step = "starting MLflow"  # what the worker does, for the message to the user
        self._failure: str | None = None  # why the last request failed; None: it did not
        self.ended = False  # whether the worker has ended
        self._last_event = monotonic()
        self._done: dict[str, str] = {}  # by folder: what could not be sent, or ""
        self.worker = start(self._on_event)

    def _on_event(self, event: SyncEvent) -> None:
        with self._changed:
            if event.kind is EventKind.PREPARING and event.text:
                self._state, self._step = WorkerState.PREPARING, event.text
            else:
                self._state, self._step = WorkerState.SENDING, "sending the records"
            if event.kind is not EventKind.PREPARING:
                self._failure = event.text if event.kind is EventKind.TROUBLE else None
            if event.kind is EventKind.DONE:
                self._done[event.folder] = event.text
            self.ended |= event.kind is EventKind.TROUBLE and not event.folder
            if self._failure is None:
                self._last_event = monotonic()
            self._changed.notify_all()

    def put(self, request: SyncRequest) -> None:
        """Make a request; return at once."""
        with self._changed:
            self._done.pop(request.folder, None)
        self.worker.put(request)

    def wait(self, requests: Sequence[SyncRequest], patience: float, uri: str) -> str:
        """Wait for requests that were made; return "", or why not everything was sent.

        The client waits while a store is made or records arrive, and else `patience` seconds,
        and prints a message after a while. Ctrl-C ends the waiting.
        """
        folders = [request.folder for request in requests]
        try:
            with self._changed:
                if not self._all_done(folders, patience, uri):
                    return self._failure or f"no answer in {patience:g} s"
                return next((text for f in folders if (text := self._done[f])), "")
        except KeyboardInterrupt:
            return "you did not wait for them"

    def _all_done(self, folders: Sequence[str], patience: float, uri: str) -> bool:
        """Wait; return whether the requests of all folders were carried out in time."""
        began, informed = monotonic(), False
        while not self._done.keys() >= set(folders):
            preparing = self._state is WorkerState.PREPARING
            limit = PREPARATION if preparing and patience else patience
            remaining = limit - (monotonic() - max(began, self._last_event))
            if remaining <= 0 or self.ended:
                return False
            if not informed and monotonic() - began >= SILENT:
                informed = True
                print(
                    f"MLflow: {uri}: {self._step}; Ctrl-C leaves, and"
                    f" `{program()} sync` sends what is missing.",
                    file=sys.stderr,
                    flush=True,
                )
            self._changed.wait(remaining if informed else min(remaining, SILENT))
        return True


_clients: Final[list[SyncClient]] = []  # at most one: runs of one process share its worker


def shared_client() -> SyncClient:
    """The client of this process's runs, whose worker loads MLflow once for all of them.

    A worker that has ended, e.g. was killed, is replaced.
    """
    if _clients and _clients[0].ended:
        close_client()
    if not _clients:
        _clients.append(SyncClient(MLflow.worker))
    return _clients[0]


@atexit.register
def close_client() -> None:
    """End the worker of this process's runs, if there is one."""
    while _clients:
        _clients.pop().worker.close()


class MLflow:
    """Mirrors one run's folder into MLflow."""

    Settings = MLflowSettings
    worker: ClassVar[Callable[[OnEvent], SyncWorker]] = SyncProcess

    @classmethod
    def make(cls, settings: MLflowSettings, home: Path) -> MLflow:
        """See `Tracker`."""
        return cls(Place.of(settings, home), settings.patience)

    @classmethod
    def ready(cls, settings: MLflowSettings, home: Path) -> None:
        """Raises TrackingError where nothing can ever be kept there."""
        check_place(Place.of(settings, home))

    def __init__(self, place: Place, patience: float) -> None:
        """`patience`: s that `finish` waits without an event, >= 0."""
        self.place = place
        self.patience = patience

    def start(self, folder: RunFolder) -> None:
        """See `Tracker`."""
        self._folder = folder
        if not folder.finished():
            shared_client().put(self._request(Status.RUNNING))

    def generation(self) -> None:
        """See `Tracker`: the child looks for generations itself."""

    def finish(self, status: Status) -> str:
        """See `Tracker`."""
        request, client = self._request(status), shared_client()
        client.put(request)
        reason = client.wait([request], self.patience, self.place.uri)
        if not reason:
            return f"MLflow: {self.place.uri}; {program()} ui shows it"
        if self.patience:
            close_client()
        uri, experiment = self.place.uri, shlex.quote(self.place.experiment)
        # `sync` asks no server that only the run's folder names.
        option = "" if self.place.file is not None else f" --uri {uri} --experiment {experiment}"
        return (
            f"MLflow: {uri} has not got all records ({reason}). They are safe; this sends them:\n"
            f"  {program()} sync {self._folder.path}{option}"
        )

    def _request(self, status: Status) -> SyncRequest:
        path, retry = str(self._folder.path.absolute()), self.patience > 0
        return SyncRequest(path, (self.place,), status, retry)


def send_sweeps(folders: Sequence[Path], patience: float, places: Iterable[Place]) -> str:
    """Send what is missing of sweeps and their jobs; return "", or why not all was sent.

    `places` are those of the jobs' configurations, whose credentials the folders lack.
    """
    client = shared_client()
    stores = tuple(dict.fromkeys(places))
    requests = [SyncRequest(str(folder.absolute()), stores) for folder in folders]
    for request in requests:
        client.put(request)
    reason = client.wait(requests, patience, "the sweep's records")
    close_client()
    return reason
