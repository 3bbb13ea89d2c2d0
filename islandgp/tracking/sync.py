"""`islandgp sync`: sends records of runs and sweeps that are missing in their store.

The stores come from the options of a command and the user's configuration. A run's configuration
only chooses one of them, by its address and experiment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from islandgp.errors import TrackingError, UntrustedError
from islandgp.gate import cleaned
from islandgp.plain import flatten
from islandgp.records.folder import RunFolder, Status, run_folders
from islandgp.records.parameters import without_credentials
from islandgp.records.sweep import read_sweep
from islandgp.tracking.store import MLflowSettings, Store, TrackingStore
from islandgp.tracking.upload import RunUploader, send_sweep

FACTORY: Final = "islandgp.tracking.mlflow:MLflow"


def place_from(uri: str, experiment: str) -> TrackingStore:
    """The store of an address that a user gave; a file has its artifacts beside it.

    Raises TrackingError.
    """
    try:
        settings = MLflowSettings(
            uri=uri, artifacts="mlartifacts", experiment=experiment, patience=0
        )
    except ValidationError:
        raise TrackingError(
            "Expected the name of an experiment, and a store as sqlite:///FILE or http://HOST:PORT,"
            " with a port from 1 to 65535 and without a password (set MLFLOW_TRACKING_USERNAME and"
            f" MLFLOW_TRACKING_PASSWORD), found {cleaned(without_credentials(uri))!r} and"
            f" {experiment!r}."
        ) from None
    place = TrackingStore.of(settings, Path.cwd())
    return (
        place
        if place.file is None
        else replace(place, artifacts=str(place.file.with_name(settings.artifacts)))
    )


def place_of(folder: RunFolder, places: Iterable[TrackingStore]) -> TrackingStore | None:
    """The one of the user's stores that a run's configuration names; None without tracking.

    Raises:
        RunError: the folder is damaged.
        UntrustedError: it names another store.
    """
    values = flatten(folder.configuration())
    if values.get("tracking.factory") != FACTORY:
        return None
    uri, experiment = (str(values.get(f"tracking.policy.{key}")) for key in ("uri", "experiment"))
    uri = uri.rstrip("/")
    for place in places:
        if (place.configured, place.experiment) == (uri, experiment):
            return place
    raise UntrustedError(
        f"Expected a store that your own command or configuration names, found {uri} with"
        f" experiment {experiment}, which only the run names; give --uri and --experiment, or"
        " --config-dir FOLDER with a file tracking/NAME.yaml."
    )


@dataclass(slots=True)
class Synced:
    """Result of a synchronization."""

    sent: list[Path] = field(default_factory=list)
    known: list[Path] = field(default_factory=list)  # the store had all of them
    untracked: list[Path] = field(default_factory=list)  # their configuration names no store
    failed: dict[Path, Exception] = field(default_factory=dict)


def sync(
    root: Path,
    place: TrackingStore | None = None,
    *,
    places: Sequence[TrackingStore] = (),
    alive: Callable[[], None] = lambda: None,
) -> Synced:
    """Sends the missing records of all runs and sweeps in a folder.

    Args:
        root: the folder.
        place: the store to send to; None: the one of `places` that a run's configuration names.
        places: the user's stores.
        alive: called when records were sent, or were in the store already.

    Returns:
        The folders by outcome, including unreachable stores and folders that cannot be sent.
    """
    done, by_store = Synced(), dict[TrackingStore, list[RunFolder]]()
    for folder in run_folders(root.resolve()):
        with _noting(folder.path, done):
            if (where := place or place_of(folder, places)) is None:
                done.untracked.append(folder.path)
                continue
            if folder.finished():
                folder.must_be_sound()  # before a store is made for it
            by_store.setdefault(where, []).append(folder)
    for where, folders in by_store.items():
        try:
            store = Store(where)
        except Exception as error:  # it is not tried again for each run
            done.failed |= dict.fromkeys((folder.path for folder in folders), error)
            continue
        for folder in folders:
            with _noting(folder.path, done):
                uploader = RunUploader(folder, store, alive)
                _, has_sent = uploader.send(folder.status())
                (done.sent if has_sent else done.known).append(folder.path)
                alive()
        for path in dict.fromkeys(folder.path.parent for folder in folders):
            with _noting(path, done):
                if (sweep := read_sweep(path)) is not None:
                    status = Status.RUNNING if sweep.at_work() else sweep.status()
                    send_sweep(sweep, store, status)
                alive()
    return done


@contextmanager
def _noting(path: Path, done: Synced) -> Iterator[None]:
    """A context whose error is that of a folder; a store and a folder may fail in any way."""
    try:
        yield
    except Exception as error:
        done.failed[path] = error
