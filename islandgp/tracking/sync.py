"""`islandgp sync`: sends records of runs and sweeps that are missing in their store."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from islandgp.errors import IslandError
from islandgp.records.folder import Status, run_folders
from islandgp.sweep.folder import SweepFolder
from islandgp.tracking.parent import send_sweep
from islandgp.tracking.place import place_of
from islandgp.tracking.store import Place, Store
from islandgp.tracking.upload import RunUploader


@dataclass(slots=True)
class Synced:
    """Result of a synchronization."""

    sent: list[Path] = field(default_factory=list)
    known: list[Path] = field(default_factory=list)  # the store had all of them
    untracked: list[Path] = field(default_factory=list)  # their configuration names no store
    failed: dict[Path, Exception] = field(default_factory=dict)


def sync(
    root: Path,
    place: Place | None = None,
    *,
    places: Sequence[Place] = (),
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
    done = Synced()
    stores: dict[Place, Store | IslandError | Exception] = {}
    sweeps: dict[Path, Place] = {}
    for folder in run_folders(root.resolve()):
        try:
            where = place or place_of(folder, places)
            if where is None:
                done.untracked.append(folder.path)
                continue
            sweeps[folder.path.parent] = where
            if folder.finished():
                folder.must_be_sound()  # before a store is made for it
            uploader = RunUploader(folder, _store(stores, where), alive)
            uploader.send(folder.status())
            (done.sent if uploader.has_sent else done.known).append(folder.path)
            alive()
        except Exception as error:  # a store may fail in any way, and a folder be damaged
            done.failed[folder.path] = error
    for path, where in sweeps.items():
        sweep = SweepFolder(path)
        try:
            if (file := sweep.read()) is None:
                continue
            status = Status.RUNNING if sweep.at_work() else sweep.status(file)
            send_sweep(sweep, _store(stores, where), status)
            alive()
        except Exception as error:  # as above
            done.failed[path] = error
    return done


def _store(stores: dict[Place, Any], place: Place) -> Store:
    """The store of a place; a place that was unreachable once is not tried again."""
    if place not in stores:
        try:
            stores[place] = Store(place)
        except Exception as error:
            stores[place] = error
    store = stores[place]
    if isinstance(store, Exception):
        raise store
    return store  # type: ignore[no-any-return]
