"""MLflow as a run's tracker: a thread that mirrors the folder while evolution goes on.

Loading MLflow takes seconds and its server may be away, so nothing of it
happens in the thread that evolves.
"""

from __future__ import annotations

from pathlib import Path
from threading import Event, Thread
from typing import Final

from islandgp.errors import brief
from islandgp.records.folder import RunFolder, Status
from islandgp.resources import program
from islandgp.tracking.mirror import Mirror, up_to_date
from islandgp.tracking.store import MLflowSettings, Place, Store, there

PERIOD: Final = 2.0  # s between two sendings while the run goes on: a call costs ten milliseconds
PAUSE: Final = 1.0  # s between two attempts after the run, while there is patience


class MLflow:
    """Mirrors one run's folder into MLflow."""

    Settings = MLflowSettings

    @classmethod
    def make(cls, settings: MLflowSettings, home: Path) -> MLflow:
        """See `Tracker`."""
        return cls(Place.of(settings, home), settings.patience)

    def __init__(self, place: Place, patience: float) -> None:
        """`patience`: s that `finish` waits at most, >= 0."""
        self.place = place
        self.patience = patience
        self._wake = Event()
        self._over = Event()
        self._given_up = Event()
        self._status = Status.RUNNING
        self._trouble = ""
        self._thread: Thread | None = None

    def start(self, folder: RunFolder) -> None:
        """See `Tracker`."""
        self._folder = folder
        file = self.place.file
        if up_to_date(folder, self.place) and (file is None or there(file)):
            return
        self._wake.set()
        self._thread = Thread(target=self._work, name="mlflow mirror", daemon=True)
        self._thread.start()

    def generation(self) -> None:
        """See `Tracker`."""
        self._wake.set()

    def finish(self, status: Status) -> str:
        """See `Tracker`."""
        self._status = status
        self._over.set()
        self._wake.set()
        try:
            if self._thread is not None:
                self._thread.join(self.patience)
        finally:
            self._given_up.set()
        if self._trouble or (self._thread is not None and self._thread.is_alive()):
            reason = self._trouble or f"no answer in {self.patience:g} s"
            return (
                f"MLflow: {self.place.uri} has not got all records ({reason}). They are safe; this"
                f" sends them:\n  {program()} sync {self._folder.path}"
            )
        return f"MLflow: {self.place.uri}; {program()} ui shows it"

    def _work(self) -> None:
        mirror: Mirror | None = None
        while True:
            self._wake.wait()
            self._wake.clear()
            status = self._status
            try:
                mirror = mirror or Mirror(self._folder, Store(self.place))
                mirror.send(status)
                self._trouble = ""
            except Exception as error:
                self._trouble = brief(error)
                mirror = None  # the store may be another one by now
            if status is Status.RUNNING:
                self._over.wait(PERIOD)
            elif not self._trouble or self._given_up.wait(PAUSE):
                return
            else:
                self._wake.set()
