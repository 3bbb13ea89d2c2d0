"""The sync process, which sends run folders to MLflow: `python -m islandgp.tracking`.

MLflow takes seconds to load, and its calls take processor time. A run leaves both to this process,
which it starts. Requests and events are lines of JSON on the standard input and output of the sync
process. It ends when its input does, or, after a `Detach`, when it has executed the last request.
All state is in the folders, so nothing is lost if it is killed.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from time import monotonic
from typing import Final

from islandgp.errors import TrackingError, brief
from islandgp.plain import from_plain
from islandgp.records.folder import RunFolder, Status
from islandgp.tracking.background import lock_note
from islandgp.tracking.store import Place, Store, load_alone
from islandgp.tracking.sync import sync
from islandgp.tracking.upload import RunUploader
from islandgp.trust import trust, trusted

PERIOD: Final = 2.0  # s between two looks at a folder; a look costs ten milliseconds
DETACHED_LIMIT: Final = 600.0  # s after which a detached process ends in any case


@dataclass(frozen=True, slots=True)
class SyncRequest:
    """A request to send one run, or, with the status None, all runs and sweeps below a folder.

    A run with the status RUNNING is followed until a request with another status replaces this.
    """

    folder: str
    places: tuple[Place, ...]  # the store of one run; for a folder, stores with known credentials
    status: Status | None = None  # of the run; None: synchronize all runs below `folder`
    retry: bool = True
    """True: repeat a failed request until it succeeds.

    A request with the status RUNNING is repeated in any case. A request for a folder succeeds also
    if some of its runs fail.
    """
    trusted: frozenset[str] = field(default_factory=trusted)
    """Names of user code that the requesting process trusts."""

    def to_line(self) -> str:
        """The request as a line of JSON. It holds credentials."""
        return json.dumps(asdict(self), default=sorted) + "\n"


@dataclass(frozen=True, slots=True)
class Detach:
    """The last message to a sync process whose parent does not wait for it.

    The process then executes its open requests and ends. It ignores the end of its input, of the
    reader of its events and of the terminal.
    """

    patience: float  # s after which a failed request is not repeated, >= 0
    note: str = ""  # file with the run's folder, to be removed when all is sent; "": none

    def to_line(self) -> str:
        """The message as a line of JSON."""
        return json.dumps(asdict(self)) + "\n"


def message_of(line: str) -> SyncRequest | Detach:
    """Read a message from its line. Raises ValueError for another line."""
    plain = json.loads(line)
    if "folder" in plain:
        return from_plain(SyncRequest, plain)
    return from_plain(Detach, plain)


class EventKind(StrEnum):
    """The kind of a message."""

    PREPARING = "preparing"  # `text`: the slow step, loading MLflow or making a store; "": done
    PROGRESS = "progress"  # something was sent, or a look at a followed run succeeded
    TROUBLE = "trouble"  # `text`: why a request failed, or, without a folder, the process ended
    DONE = "done"  # the last request for a folder was executed; `text`: the first failure, or ""


@dataclass(frozen=True, slots=True)
class SyncEvent:
    """A message about requests, from the sync process.

    `SyncProcess` adds one itself: TROUBLE without a folder, when the process has ended.
    """

    kind: EventKind
    text: str = ""
    folder: str = ""  # of the request; "" if the event concerns no single request


OnEvent = Callable[[SyncEvent], None]


class Follower:
    """Executes the open requests in turn, every PERIOD and when a request arrives."""

    def __init__(self, on_event: OnEvent) -> None:
        self._on_event = on_event
        self._uploaders: dict[str, RunUploader] = {}

    def run(self, requests: Queue[SyncRequest | Detach | None]) -> bool:
        """Execute the requests of a queue until it yields None, or the last after a `Detach`.

        Returns:
            True unless the last request was given up after a `Detach`.
        """
        open_requests: dict[str, SyncRequest] = {}
        end: float | None = None  # of repeating failed requests, as the clock says
        succeeded = True
        while open_requests or end is None:
            with suppress(Empty):
                message = requests.get(timeout=PERIOD if open_requests else None)
                if message is None:
                    break
                if isinstance(message, Detach):
                    end = monotonic() + message.patience
                else:
                    open_requests[message.folder] = message
            for request in tuple(open_requests.values()):
                succeeded = self._carry_out(request)
                retry = request.retry and (end is None or monotonic() < end)
                is_last = request.status is not Status.RUNNING or end is not None
                if is_last and (succeeded or not retry):
                    del open_requests[request.folder]
        return succeeded

    def _carry_out(self, request: SyncRequest) -> bool:
        """Execute a request once; return True unless it failed."""
        trust(request.trusted)
        try:
            text = ""
            if request.status is None:
                text = self._sync(request)
            else:
                self._send(request, request.status)
        except Exception as error:  # a store may fail in any way, and a folder be damaged
            self._uploaders.pop(request.folder, None)  # the store may have been replaced
            self._on_event(SyncEvent(EventKind.TROUBLE, brief(error), request.folder))
            return False
        done = request.status is not Status.RUNNING
        kind = EventKind.DONE if done else EventKind.PROGRESS
        self._on_event(SyncEvent(kind, text, request.folder))
        return True

    def _send(self, request: SyncRequest, status: Status) -> None:
        """Send one run."""
        folder = Path(request.folder)
        if not folder.is_dir():  # locking it would make it again
            raise TrackingError(f"Expected a run's folder, found no folder {folder}.")
        (place,) = request.places
        uploader = self._uploaders.get(request.folder)
        if uploader is None or uploader.store.place != place:
            store = Store(place, self._preparing)
            uploader = RunUploader(RunFolder(folder), store, self._progress)
            self._uploaders[request.folder] = uploader
        uploader.send(status)
        if status is not Status.RUNNING:
            del self._uploaders[request.folder]

    def _sync(self, request: SyncRequest) -> str:
        """Synchronize a folder; return the first failure, or ""."""
        result = sync(
            Path(request.folder),
            places=request.places,
            alive=self._progress,
            preparing=self._preparing,
        )
        return next((f"{path}: {brief(error)}" for path, error in result.failed.items()), "")

    def _preparing(self, text: str) -> None:
        self._on_event(SyncEvent(EventKind.PREPARING, text))

    def _progress(self) -> None:
        self._on_event(SyncEvent(EventKind.PROGRESS))


def serve() -> None:
    """Read requests from standard input, and write events to standard output."""
    events = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)  # libraries that print to standard output must not break the events
    requests: Queue[SyncRequest | Detach | None] = Queue()
    results: Queue[bool] = Queue()

    def on_event(event: SyncEvent) -> None:
        with suppress(OSError):  # the run's process has ended
            print(json.dumps(asdict(event)), file=events, flush=True)

    def work() -> None:
        try:
            on_event(SyncEvent(EventKind.PREPARING, "loading MLflow"))
            load_alone()
            results.put(Follower(on_event).run(requests))
        except BaseException:  # else the process would live on and execute no request
            traceback.print_exc()  # `SyncProcess` reports its last line
            os._exit(1)

    Thread(target=work, daemon=True).start()
    for line in sys.stdin:
        if not line.endswith("\n"):  # the run's process died while it wrote
            break
        message = message_of(line)
        requests.put(message)
        if isinstance(message, Detach):
            _outlive_command(message, results)
    os._exit(0)  # does not wait for the thread, which may be in the middle of a request


def _outlive_command(message: Detach, results: Queue[bool]) -> None:
    """Wait for the last request; the end of the terminal does not end the process."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    note = Path(message.note) if message.note else None
    if note is not None:  # in a thread, because another process may have the lock for long
        Thread(target=_lock, args=(note,), daemon=True).start()
    with suppress(Empty, OSError):
        if results.get(timeout=DETACHED_LIMIT) and note is not None:
            note.unlink(missing_ok=True)


def _lock(note: Path) -> None:
    """Lock a note until the process ends. Without a lock, it still sends its run."""
    with suppress(ImportError, OSError):
        lock_note(note, blocking=True)
