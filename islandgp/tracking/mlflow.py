"""The MLflow tracker: copies a run's folder to MLflow in a thread, during the run.

Importing MLflow takes seconds, and its server may not answer. The run never waits for either before
its end.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Final

from islandgp.errors import RunError, TrackingError, brief
from islandgp.records.folder import RunFolder, Status, run_folders
from islandgp.resources import program
from islandgp.tracking.place import place_of
from islandgp.tracking.sender import sender
from islandgp.tracking.store import MLflowSettings, Place, Store, check_place
from islandgp.tracking.sync import sync
from islandgp.tracking.upload import RunUploader

DEFAULT: Final = ("sqlite:///mlflow.db", "islandgp")
"""Address and experiment in the package's configuration."""

PERIOD: Final = 2.0  # least s between two batches of an unfinished run


class MLflow:
    """Copies one run's folder to MLflow."""

    Settings = MLflowSettings

    @classmethod
    def make(cls, settings: MLflowSettings, home: Path) -> MLflow:
        """See `Tracker`."""
        return cls(Place.of(settings, home), settings.patience)

    @classmethod
    def check(cls, settings: MLflowSettings, home: Path) -> None:
        """See `Tracker`. Raises TrackingError if runs can never be stored at this address."""
        check_place(Place.of(settings, home))

    def __init__(self, place: Place, patience: float) -> None:
        """Starts nothing.

        Args:
            place: of the store.
            patience: s that `finish` waits without an answer of the store, >= 0.
        """
        self.place = place
        self.patience = patience
        self._uploader: RunUploader | None = None  # of the sender's thread
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
        uploader, self._uploader = self._uploader, None  # after an error, the store is opened again
        if uploader is None:
            folder, store = RunFolder(self._path), Store(self.place)
            uploader = RunUploader(folder, store, sender().alive, has_own_page=True)
        uploader.send(status)
        self._uploader = uploader
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


def sync_command(folders: Sequence[Path], places: Sequence[Place]) -> str:
    """The command that sends the missing records of folders to their stores; a line for each."""
    if len({*places}) == 1:
        words = [program(), "sync", *(shlex.quote(str(folder.absolute())) for folder in folders)]
        return " ".join([*words, *store_options(places[0])])
    jobs: dict[Place, list[Path]] = {place: [] for place in places}
    for run in (run for folder in folders for run in run_folders(folder)):
        with suppress(RunError):  # a damaged one is reported by `sync`
            if place := place_of(run, places):
                jobs[place].append(run.path)
    return "\n  ".join(sync_command(runs, [place]) for place, runs in jobs.items() if runs)


def store_options(place: Place) -> list[str]:
    """The options by which `sync` and `ui` find a store; none for that of the package's files."""
    if place.configured == DEFAULT and place.file == Path.cwd() / "mlflow.db":
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
