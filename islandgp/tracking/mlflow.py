"""The MLflow tracker: a child process sends the run's folder to MLflow during evolution.

Importing MLflow takes seconds, and its server may not respond. So the child imports MLflow and
connects to the server, and evolution does not wait for it.
"""

from __future__ import annotations

import atexit
import json
import math
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from threading import Condition, Thread
from time import monotonic
from typing import ClassVar, Final, Protocol

from islandgp.plain import from_plain
from islandgp.records.folder import RunFolder, Status
from islandgp.resources import program
from islandgp.tracking.background import (
    left_run,
    note_of,
    seems_usable,
    write_note,
)
from islandgp.tracking.follow import Detach, EventKind, OnEvent, SyncEvent, SyncRequest
from islandgp.tracking.store import MLflowSettings, Place, check_place
from islandgp.waiting import command_waits

PREPARATION_LIMIT: Final = 600.0  # s for importing MLflow or creating a store
MESSAGE_DELAY: Final = 2.0  # s of waiting before the user gets a message
QUIET_PERIOD: Final = 30.0
"""Seconds of a run without a child, if the command does not wait for it.

Loading MLflow takes the workers' cores for a second or two, also at the lowest priority.
"""
COMMAND: Final = (sys.executable, "-P", "-m", "islandgp.tracking")
NICENESS: Final = 5
"""An episode's process gets three times the CPU time of the child.

A higher value would delay the end of a run that waits for it.
"""
BACKGROUND_NICENESS: Final = 19  # of a child for which the command need not wait


class SyncWorker(Protocol):
    """Interface of the sync worker, which executes requests (a subprocess; a thread in tests)."""

    def put(self, message: SyncRequest | Detach) -> None:
        """Queue a message; return immediately."""
        ...

    def close(self) -> None:
        """Stop the worker, even in the middle of a request if possible."""
        ...


class SyncProcess:
    """A child process that executes requests."""

    def __init__(self, on_event: OnEvent, niceness: int = NICENESS) -> None:
        """`niceness`: of the child, from 0 to 19."""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 -- it lives as long as the child
        self.process = subprocess.Popen(
            (*COMMAND, str(niceness)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            # The child imports from the same folders as this process.
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))},
            # In its own process group, the child gets no signal from Ctrl-C. It stays in the
            # session, because Linux compares niceness within a session only.
            process_group=0,
        )
        self._listener = Thread(target=self._listen, args=(on_event,), daemon=True)
        self._listener.start()

    def put(self, message: SyncRequest | Detach) -> None:
        """See `SyncWorker`."""
        assert self.process.stdin is not None
        with suppress(OSError, ValueError):  # the child has ended; `_listen` reports that
            self.process.stdin.write(message.to_line())
            self.process.stdin.flush()

    def _listen(self, on_event: OnEvent) -> None:
        """Pass the child's events on; when it has ended, a last event with the reason."""
        assert self.process.stdout is not None
        # The last line of a killed child may be incomplete.
        with suppress(ValueError), self.process.stdout as lines:
            for line in lines:
                on_event(from_plain(SyncEvent, json.loads(line)))
        self.process.wait()
        with self._errors:
            self._errors.seek(0)
            errors = self._errors.read().decode(errors="replace").strip().splitlines()
        reason = errors[-1] if errors else f"exit code {self.process.returncode}"
        on_event(SyncEvent(EventKind.TROUBLE, f"the process that sends them ended: {reason}"))

    def close(self) -> None:
        """See `SyncWorker`."""
        assert self.process.stdin is not None
        self.process.kill()
        self._listener.join()
        with suppress(OSError):  # requests that the child has not read
            self.process.stdin.close()


class SyncClient:
    """Sends requests to a worker and waits for their completion."""

    def __init__(self, start: Callable[[OnEvent], SyncWorker]) -> None:
        """`start` starts the worker."""
        self._changed = Condition()
        self._preparing = True  # the worker imports MLflow or creates a store
        self._step = "starting MLflow"  # the worker's present step, for the message to the user
        self._failure: str | None = None  # the last trouble; None: the last request succeeded
        self._answered = False  # True: the last answer of a store was a success
        self.ended = False  # True: the worker has ended
        self._last_event = monotonic()
        self._done: dict[str, str] = {}  # by folder: why not all was sent, or ""
        self.worker = start(self._on_event)

    def _on_event(self, event: SyncEvent) -> None:
        with self._changed:
            self._preparing = event.kind is EventKind.PREPARING and event.text != ""
            self._step = event.text if self._preparing else "sending the records"
            if event.kind is not EventKind.PREPARING:
                self._answered = event.kind is not EventKind.TROUBLE
                self._failure = event.text if event.kind is EventKind.TROUBLE else None
            if event.kind is EventKind.DONE:
                self._done[event.folder] = event.text
            self.ended |= event.kind is EventKind.TROUBLE and not event.folder
            if self._failure is None:
                self._last_event = monotonic()
            self._changed.notify_all()

    def put(self, request: SyncRequest) -> None:
        """Queue a request; return immediately."""
        with self._changed:
            self._done.pop(request.folder, None)
        self.worker.put(request)

    def wait(
        self,
        requests: Sequence[SyncRequest],
        patience: float,
        uri: str,
        *,
        leave_after: float | None = None,
    ) -> str:
        """Wait until requests are executed.

        Prints a message after MESSAGE_DELAY. Ctrl-C ends the waiting.

        Args:
            requests: that were passed to `put`.
            patience: s without an event after which it gives up, >= 0. If it is above 0, the limit
                is PREPARATION_LIMIT while the worker is preparing.
            uri: of the store, for the message.
            leave_after: s after which it does not wait unless the last request failed, >= 0; it
                also leaves when the store has answered a request, perhaps an earlier one. None: it
                waits for the execution.

        Returns:
            "", or the reason why not everything was sent.
        """
        folders = [request.folder for request in requests]
        try:
            with self._changed:
                if not self._all_done(folders, patience, uri, leave_after):
                    return self._failure or f"no answer in {patience:g} s"
                return next((text for f in folders if (text := self._done.get(f))), "")
        except KeyboardInterrupt:
            return "waiting was interrupted"

    def has_sent(self, folder: str) -> bool:
        """True if the last request for a folder was executed."""
        with self._changed:
            return folder in self._done

    def _all_done(
        self, folders: Sequence[str], patience: float, uri: str, leave_after: float | None
    ) -> bool:
        """Wait; return False if the requests of all folders were not executed in time."""
        began, informed = monotonic(), False
        while not self._done.keys() >= set(folders):
            waited = monotonic() - began
            answered = self._answered and not self._preparing
            leaves = leave_after is not None and (answered or waited >= leave_after)
            if leaves and self._failure is None:
                return True
            limit = PREPARATION_LIMIT if self._preparing and patience else patience
            remaining = limit - (monotonic() - max(began, self._last_event))
            if remaining <= 0 or self.ended:
                return False
            if not informed and waited >= MESSAGE_DELAY:
                informed = True
                print(
                    f"MLflow: {uri}: {self._step}; Ctrl-C leaves, and"
                    f" `{program()} sync` sends what is missing.",
                    file=sys.stderr,
                    flush=True,
                )
            self._changed.wait(remaining if informed else min(remaining, MESSAGE_DELAY - waited))
        return True


_clients: Final[list[SyncClient]] = []  # at most one, which all runs of the process share


def shared_client(niceness: int = NICENESS) -> SyncClient:
    """The client of all runs of this process, whose worker imports MLflow once.

    A worker that has ended, e.g. because it was killed, is replaced. `niceness`: of a new worker.
    """
    if _clients and _clients[0].ended:
        close_client()
    if not _clients:
        _clients.append(SyncClient(lambda on_event: MLflow.worker(on_event, niceness)))
    return _clients[0]


@atexit.register
def close_client() -> None:
    """Stop the worker of this process's runs, if there is one."""
    while _clients:
        _clients.pop().worker.close()


class MLflow:
    """Copies one run's folder to MLflow."""

    Settings = MLflowSettings
    worker: ClassVar[Callable[[OnEvent, int], SyncWorker]] = SyncProcess

    @classmethod
    def make(cls, settings: MLflowSettings, home: Path) -> MLflow:
        """See `Tracker`."""
        waits = command_waits(settings.wait)
        return cls(Place.of(settings, home), settings.patience, background=not waits)

    @classmethod
    def check(cls, settings: MLflowSettings, home: Path) -> None:
        """See `Tracker`. Raises TrackingError if runs can never be stored at this address."""
        check_place(Place.of(settings, home))

    def __init__(self, place: Place, patience: float, *, background: bool = False) -> None:
        """Starts nothing.

        Args:
            place: of the store.
            patience: s that `finish` waits without an event, >= 0. With 0, failed requests are not
                repeated and the child is kept for the next run.
            background: True: a command that ends with the run does not wait for the child.
        """
        self.place = place
        self.patience = patience
        self._background = background
        self._may_leave = False  # True: the command ends with this run
        self._follows = True  # the child follows the run, or the run needs no following
        self._due = 0.0  # time of the clock at which the child starts to follow the run

    def allow_background(self) -> None:
        """See `BackgroundTracker`."""
        self._may_leave = self._background

    def start(self, folder: RunFolder) -> None:
        """See `Tracker`."""
        self._folder = folder
        self._follows = folder.finished()
        # A server must have answered before the command leaves the child.
        delays = self._may_leave and self.place.file is not None
        self._due = monotonic() + (QUIET_PERIOD if delays else 0)
        self.generation()

    def generation(self) -> None:
        """See `Tracker`. Starts the child when it is due; it watches the folder."""
        if not self._follows and monotonic() >= self._due:
            self._follows = True
            niceness = NICENESS if self.place.file is None else self._niceness()
            shared_client(niceness).put(self._request(Status.RUNNING))

    def _niceness(self) -> int:
        return BACKGROUND_NICENESS if self._may_leave else NICENESS

    def finish(self, status: Status) -> str:
        """See `Tracker`."""
        request, uri, file = self._request(status), self.place.uri, self.place.file
        left = left_run(note_of(file)) if self._may_leave and file is not None else None
        leaves = self._may_leave and status is Status.FINISHED and left is None
        if file is not None:
            leaves = leaves and seems_usable(file, self.place.experiment)
        client = shared_client(BACKGROUND_NICENESS if leaves else NICENESS)
        client.put(request)
        leave_after = None if not leaves else math.inf if file is None else 0.0
        reason = client.wait([request], self.patience, uri, leave_after=leave_after)
        hint = ""
        if left:
            command = _sync_command(left)
            hint = f"\nMLflow may lack records of a run before; this sends them:\n  {command}"
        if not reason:
            line = f"MLflow: {uri}; {program()} ui shows it"
            if not leaves or client.has_sent(request.folder):
                return line + hint
            return f"{line}. {self._leave(client)}"
        if self.patience:
            close_client()
        return (
            f"MLflow: {uri} has not received all records ({reason}). They are safe on disk; this"
            f" command sends them:\n  {self._sync_command()}{hint}"
        )

    def _leave(self, client: SyncClient) -> str:
        """Leave the child to its last request; return a sentence about it."""
        note = ""
        if self.place.file is not None:
            file = note_of(self.place.file)
            # Without a note, e.g. on a full disk, only the hint of a later command is lost.
            note = str(file) if write_note(file, self._folder.path) else ""
        client.worker.put(Detach(self.patience, note))
        _clients.remove(client)  # its worker is not stopped with this process
        return (
            "A process sends the last records now; if it is stopped,"
            f" {self._sync_command()} sends them."
        )

    def _sync_command(self) -> str:
        command = _sync_command(self._folder.path)
        if self.place.file is not None:
            return command
        # `sync` contacts no server that only the run's folder names, so the command names it.
        uri, experiment = shlex.quote(self.place.uri), shlex.quote(self.place.experiment)
        return f"{command} --uri {uri} --experiment {experiment}"

    def _request(self, status: Status) -> SyncRequest:
        path, retry = str(self._folder.path.absolute()), self.patience > 0
        return SyncRequest(path, (self.place,), status, retry)


def _sync_command(folder: Path | str) -> str:
    return f"{program()} sync {shlex.quote(str(folder))}"


def send_sweeps(folders: Sequence[Path], patience: float, places: Iterable[Place]) -> str:
    """Send the missing records of sweeps and their jobs.

    Args:
        folders: of the sweeps.
        patience: s without an event after which it gives up, >= 0.
        places: the stores of the jobs' configurations, as the folders have no credentials.

    Returns:
        "", or the reason why not everything was sent.
    """
    client = shared_client()
    stores = tuple(dict.fromkeys(places))
    requests = [SyncRequest(str(folder.absolute()), stores) for folder in folders]
    for request in requests:
        client.put(request)
    reason = client.wait(requests, patience, "the sweep's records")
    close_client()
    return reason
