"""`islandgp sync`: sends the records of runs and sweeps that their store has not got yet."""

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
from islandgp.tracking.store import Place, Preparing, Store
from islandgp.tracking.upload import RunUploader, must_be_sendable


@dataclass(slots=True)
class Synced:
    """Result of sending the folders."""

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
    preparing: Preparing = lambda _: None,
) -> Synced:
    """Sends what is missing of all runs and sweeps below `root`, to `place` if it is given.

    A store that is away, or a folder that cannot be sent, is in the result. `places` are
    those whose credentials are known: the folders hold none. `alive` is called whenever
    something has arrived, or was there; `preparing` as `Store` does.
    """
    done = Synced()
    known = {place: place for place in places}
    stores: dict[Place, Store | IslandError | Exception] = {}
    sweeps: dict[Path, Place] = {}
    for folder in run_folders(root.resolve()):
        try:
            where = place or place_of(folder)
            if where is None:
                done.untracked.append(folder.path)
                continue
            where = known.get(where, where)
            sweeps[folder.path.parent] = where
            status = folder.status()
            must_be_sendable(folder, status)
            uploader = RunUploader(folder, _store(stores, where, preparing), alive)
            uploader.send(status)
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
            send_sweep(sweep, _store(stores, where, preparing), status)
            alive()
        except Exception as error:  # as above
            done.failed[path] = error
    return done


def _store(stores: dict[Place, Any], place: Place, preparing: Preparing) -> Store:
    """The place's store; a place that was away once is not asked again."""
    if place not in stores:
        try:
            stores[place] = Store(place, preparing)
        except Exception as error:
            stores[place] = error
    store = stores[place]
    if isinstance(store, Exception):
        raise store
    return store  # type: ignore[no-any-return]
