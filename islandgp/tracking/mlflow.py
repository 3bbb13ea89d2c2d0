"""MLflow as a run's tracker: a sender beside the run mirrors the folder while evolution goes on.

Loading MLflow takes seconds and its server may be away, so nothing of it happens in the
process that evolves.
"""

from __future__ import annotations

import atexit
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from itertools import count
from pathlib import Path
from threading import Condition
from time import monotonic
from typing import ClassVar, Final

from islandgp.records.folder import RunFolder, Status
from islandgp.resources import program
from islandgp.tracking.sender import InProcess, Kind, Order, Report, Sender, Tell
from islandgp.tracking.store import MLflowSettings, Place, check_place

PREPARATION: Final = 600.0  # s that loading MLflow or making a store may take
SILENT: Final = 2.0  # s of waiting before the user is told

numbers: Final = count()  # of orders, each of them given once


class SenderClient:
    """Gives orders to a sender, and waits for them as long as there is a reason to."""

    def __init__(self, make: Callable[[Tell], Sender]) -> None:
        """`make` makes the sender, now and once more where it ends."""
        self._make = make
        self._changed = Condition()
        self._open()

    def _open(self) -> None:
        self._preparing = "starting MLflow"  # "": what is asked for could come any moment
        self._trouble = ""  # why nothing comes
        self.ended = False  # whether there is no sender any more
        self._heard = monotonic()
        self._done: dict[int, str] = {}  # what each order could not send for good
        self._sender = self._make(self._hear)

    def _hear(self, report: Report) -> None:
        with self._changed:
            match report.kind:
                case Kind.PREPARING:
                    self._preparing = report.text
                case Kind.SENT:
                    self._trouble = self._preparing = ""
                case Kind.TROUBLE:
                    self._trouble, self._preparing = report.text, ""
                    self.ended = report.number < 0
                case Kind.DONE:
                    self._trouble = self._preparing = ""
                    self._done[report.number] = report.text
            if not self._trouble:
                self._heard = monotonic()
            self._changed.notify_all()

    def give(self, order: Order) -> None:
        """Gives an order; returns at once."""
        self._sender.add(order)

    def wait(self, orders: Sequence[Order], patience: float, uri: str) -> str:
        """Waits for orders that were given; returns "", or why not everything was sent.

        It waits while a store is made or records arrive, and else `patience` seconds: until
        then, after a while, it tells the user so. Ctrl-C ends the waiting.
        """
        try:
            if not self._waited(orders, patience, uri) and self.ended and patience:
                self.close()
                self._open()
                for order in orders:
                    self.give(order)
                self._waited(orders, patience, uri)
        except KeyboardInterrupt:
            return "you did not wait for them"
        with self._changed:
            missing = [order for order in orders if order.number not in self._done]
            lost = [why for order in orders if (why := self._done.get(order.number))]
        if missing:
            return self._trouble or f"no answer in {patience:g} s"
        return lost[0] if lost else ""

    def _waited(self, orders: Sequence[Order], patience: float, uri: str) -> bool:
        """Whether all orders were carried out in time."""
        began, told = monotonic(), False
        with self._changed:
            while any(order.number not in self._done for order in orders):
                limit = PREPARATION if self._preparing and patience else patience
                left = limit - (monotonic() - max(began, self._heard))
                if left <= 0 or self.ended:
                    return False
                if not told and monotonic() - began >= SILENT:
                    told = True
                    what = self._preparing or "sending the records"
                    print(
                        f"MLflow: {uri}: {what}; Ctrl-C leaves, and `{program()} sync` sends"
                        " what is missing.",
                        file=sys.stderr,
                        flush=True,
                    )
                self._changed.wait(left if told else min(left, SILENT))
        return True

    def close(self) -> None:
        """Ends the sender."""
        self._sender.close()


_clients: Final[list[SenderClient]] = []  # at most one: runs of one process share its sender


def shared_client(make: Callable[[Tell], Sender]) -> SenderClient:
    """The client of this process's runs, whose sender has loaded MLflow once for all of them."""
    if _clients and _clients[0].ended:
        close_client()
    if not _clients:
        _clients.append(SenderClient(make))
    return _clients[0]


@atexit.register
def close_client() -> None:
    """Ends the sender of this process's runs, if there is one."""
    while _clients:
        _clients.pop().close()


class MLflow:
    """Mirrors one run's folder into MLflow."""

    Settings = MLflowSettings
    sender: ClassVar[Callable[[Tell], Sender]] = InProcess

    @classmethod
    def make(cls, settings: MLflowSettings, home: Path) -> MLflow:
        """See `Tracker`."""
        return cls(Place.of(settings, home), settings.patience)

    @classmethod
    def ready(cls, settings: MLflowSettings, home: Path) -> None:
        """Raises TrackingError where nothing can ever be kept there."""
        check_place(Place.of(settings, home))

    def __init__(self, place: Place, patience: float) -> None:
        """`patience`: s without a word of the store that `finish` waits, >= 0."""
        self.place = place
        self.patience = patience

    def start(self, folder: RunFolder) -> None:
        """See `Tracker`."""
        self._folder = folder
        self._client = shared_client(MLflow.sender)
        if not folder.finished():
            self._client.give(self._order(Status.RUNNING))

    def generation(self) -> None:
        """See `Tracker`: the sender looks for generations by itself."""

    def finish(self, status: Status) -> str:
        """See `Tracker`."""
        order = self._order(status)
        self._client.give(order)
        reason = self._client.wait([order], self.patience, self.place.uri)
        if not reason:
            return f"MLflow: {self.place.uri}; {program()} ui shows it"
        if self.patience:
            close_client()
        return (
            f"MLflow: {self.place.uri} has not got all records ({reason}). They are safe; this"
            f" sends them:\n  {program()} sync {self._folder.path}{self._option()}"
        )

    def _option(self) -> str:
        """The option by which `sync` is told of a server that only this command names."""
        if self.place.file is not None:
            return ""
        return f" --uri {self.place.uri} --experiment {shlex.quote(self.place.experiment)}"

    def _order(self, status: Status) -> Order:
        again = status is Status.RUNNING or self.patience > 0
        return Order(next(numbers), str(self._folder.path.absolute()), status, self.place, again)


def send_sweeps(folders: Sequence[Path], patience: float, places: Iterable[Place]) -> str:
    """Sends what is missing of sweeps and their jobs; returns "", or why not all was sent.

    `places` are those of the jobs' configurations, whose credentials the folders lack.
    """
    client = shared_client(MLflow.sender)
    several = tuple(dict.fromkeys(places))
    orders = [Order(next(numbers), str(f.absolute()), places=several) for f in folders]
    for order in orders:
        client.give(order)
    reason = client.wait(orders, patience, "the sweep's records")
    close_client()
    return reason
