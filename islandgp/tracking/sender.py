"""Sends run folders to MLflow beside the work, in a process of its own.

MLflow takes seconds to load, and its calls take processor time from whoever makes them. A
run therefore leaves both to a process that gets pickled orders on its standard input, answers
with pickled reports on its standard output, and ends with its input, however its parent ends.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from threading import Condition, Lock, Thread
from typing import Final, Protocol

from islandgp.errors import brief
from islandgp.records.folder import RunFolder, Status
from islandgp.tracking.mirror import Mirror
from islandgp.tracking.store import Place, Store, load_alone
from islandgp.tracking.sync import sync
from islandgp.trust import trust, trusted

PERIOD: Final = 2.0  # s between two sendings while a run goes on: a call costs ten milliseconds
PAUSE: Final = 1.0  # s between two attempts
NICENESS: Final = 10  # of what is sent while episodes run: they go first
CLOSED: Final = (EOFError, pickle.UnpicklingError)  # the other process has ended, or was killed


@dataclass(frozen=True, slots=True)
class Order:
    """What is to be sent: a run's folder, or with no place all that is below a folder.

    A run that goes on is looked at again and again, until it is over.
    """

    number: int
    folder: str
    status: Status = Status.RUNNING
    place: Place | None = None
    again: bool = True  # whether it is tried until it succeeds
    places: tuple[Place, ...] = ()  # with credentials, which no folder holds
    trusted: frozenset[str] = field(default_factory=trusted)  # by whoever gives the order

    @property
    def waits(self) -> bool:
        """Whether a command waits for it: all but the generations of a run that goes on."""
        return self.place is None or self.status is not Status.RUNNING


class Kind(StrEnum):
    """What a report tells."""

    PREPARING = "preparing"  # MLflow is loaded, or a store made: `text` says it
    SENT = "sent"  # some records more are there
    TROUBLE = "trouble"  # why an order cannot be carried out now; it is tried again
    DONE = "done"  # an order is carried out; `text` tells what could not be sent for good


@dataclass(frozen=True, slots=True)
class Report:
    """A word of the sender."""

    kind: Kind
    text: str = ""
    number: int = -1  # the order's, with TROUBLE and DONE


Tell = Callable[[Report], None]


class Worker:
    """Carries out orders one after the other."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._orders: dict[str, Order] = {}  # by folder: a new one takes the place of an old one
        self._changed = Condition()
        self._urgent = False  # whether a command has come to wait
        self._ended = False
        self._mirrors: dict[str, Mirror] = {}

    def add(self, order: Order) -> None:
        """Takes an order; returns at once."""
        with self._changed:
            self._orders[order.folder] = order
            self._urgent |= order.waits
            self._changed.notify()

    def end(self) -> None:
        """Makes `work` return after the order that it is carrying out."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def work(self) -> None:
        """Carries out what there is and what will come, until `end` is called."""
        while orders := self._taken():
            waits = [order for order in orders if order.waits]
            goes_on = [order for order in orders if not order.waits]
            kept = goes_on + [order for order in self._carry_out(waits) if order.again]
            if goes_on:
                _behind(partial(self._carry_out, goes_on))
            with self._changed:
                for order in kept:
                    self._orders.setdefault(order.folder, order)
                self._changed.wait_for(
                    lambda: self._urgent or self._ended, PAUSE if waits else PERIOD
                )

    def _taken(self) -> list[Order]:
        """The orders that there are, when there are any; none at the end."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._orders) or self._ended)
            orders, self._orders = list(self._orders.values()), {}
            self._urgent = False
            return [] if self._ended else orders

    def _carry_out(self, orders: list[Order]) -> list[Order]:
        """Carries the orders out; returns those that failed."""
        return [order for order in orders if not self._carried_out(order)]

    def _carried_out(self, order: Order) -> bool:
        trust(order.trusted)
        try:
            trouble = "" if order.place else self._sync(order)
            if order.place:
                self._send(order, order.place)
        except Exception as error:  # a store may fail in any way, and a folder be damaged
            self._mirrors.pop(order.folder, None)  # the store may be another one by now
            self._tell(Report(Kind.TROUBLE, brief(error), order.number))
            return False
        self._tell(Report(Kind.DONE, trouble, order.number))
        return True

    def _send(self, order: Order, place: Place) -> None:
        mirror = self._mirrors.get(order.folder)
        if mirror is None or mirror.store.place != place:
            store = Store(place, self._preparing)
            mirror = Mirror(RunFolder(Path(order.folder)), store, self._sent)
            self._mirrors[order.folder] = mirror
        mirror.send(order.status)
        if order.waits:
            del self._mirrors[order.folder]

    def _sync(self, order: Order) -> str:
        root, places = Path(order.folder), order.places
        found = sync(root, places=places, alive=self._sent, preparing=self._preparing)
        lines = [f"{path}: {brief(error)}" for path, error in found.failed.items()]
        return lines[0] if lines else ""

    def _preparing(self, what: str) -> None:
        self._tell(Report(Kind.PREPARING, what))

    def _sent(self) -> None:
        self._tell(Report(Kind.SENT))


def _behind(work: Callable[[], object]) -> None:
    """Does some work in a thread that lets other processes go first."""

    def nicely() -> None:
        if sys.platform == "linux":  # where each thread has a niceness of its own
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        work()

    thread = Thread(target=nicely, name="sender of generations", daemon=True)
    thread.start()
    thread.join()


class Sender(Protocol):
    """Somebody who takes orders: a process, or what stands in for one."""

    def add(self, order: Order) -> None:
        """Takes an order; returns at once."""
        ...

    def close(self) -> None:
        """Ends it, whatever it is doing, if that is possible."""
        ...


START: Final = """
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from islandgp.tracking.sender import main
main()
"""
"""The program of a sender's process, which finds the modules that its parent finds."""


class InProcess:
    """A sender in a process of its own."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 -- it lives as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-c", START, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            # Ctrl-C is the parent's to handle. The session stays the same: Linux weighs niceness
            # within a session only.
            process_group=0,
        )
        self._listener = Thread(target=self._listen, name="sender", daemon=True)
        self._listener.start()

    def add(self, order: Order) -> None:
        """See `Sender`."""
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # it has ended: `_listen` tells
            pickle.dump(order, self._process.stdin)
            self._process.stdin.flush()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with suppress(*CLOSED):
            while True:
                self._tell(pickle.load(self._process.stdout))
        self._process.wait()
        with self._errors:
            self._errors.seek(0)
            said = self._errors.read().decode(errors="replace").strip().splitlines()
        self._process.stdout.close()
        why = said[-1] if said else f"exit code {self._process.returncode}"
        self._tell(Report(Kind.TROUBLE, f"the process that sends them ended: {why}"))

    def close(self) -> None:
        """See `Sender`."""
        assert self._process.stdin is not None
        self._process.kill()
        self._listener.join()
        with suppress(OSError):  # what it has not read
            self._process.stdin.close()


def main() -> None:
    """The process's own part: orders from its standard input, reports to its standard output."""
    reports = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever libraries print is no report
    one_at_a_time = Lock()

    def tell(report: Report) -> None:
        with one_at_a_time, suppress(OSError):  # nobody listens any more
            pickle.dump(report, reports)
            reports.flush()

    worker = Worker(tell)

    def work() -> None:
        tell(Report(Kind.PREPARING, "loading MLflow"))
        _behind(load_alone)
        worker.work()

    Thread(target=work, daemon=True).start()
    with suppress(*CLOSED):
        while True:
            worker.add(pickle.load(sys.stdin.buffer))
    os._exit(0)  # whatever it is doing
