"""`islandgp sync`: sends the records of runs and sweeps that their store has not got yet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from islandgp.errors import IslandError
from islandgp.tracking.folder import RunFolder, Status
from islandgp.tracking.mirror import Mirror, up_to_date
from islandgp.tracking.parent import send_sweep
from islandgp.tracking.store import MLflowSettings, Place, Store
from islandgp.tracking.sweep_folder import SweepFolder

FACTORY = "islandgp.tracking.mlflow:MLflow"


@dataclass(slots=True)
class Synced:
    """What became of the folders."""

    sent: list[Path] = field(default_factory=list)
    known: list[Path] = field(default_factory=list)  # the store had all of them
    untracked: list[Path] = field(default_factory=list)  # their configuration names no store
    failed: dict[Path, Exception] = field(default_factory=dict)


def run_folders(root: Path) -> Iterator[RunFolder]:
    """Every run at or below a folder, in the order of their names."""
    for file in sorted(root.rglob("about.json")):
        yield RunFolder(file.parent)


def place_of(folder: RunFolder) -> Place | None:
    """Where a run's own configuration sends it; None with `tracking=off`."""
    config: dict[str, Any] = yaml.safe_load(folder.config() or "{}") or {}
    tracking, about = config.get("tracking", {}), folder.about()
    if tracking.get("factory") != FACTORY or about is None:
        return None
    return Place.of(MLflowSettings(**tracking["policy"]), Path(about.home))


def sync(root: Path, place: Place | None = None) -> Synced:
    """Sends what is missing of all runs and sweeps below `root`, to `place` if it is given.

    A store that is away, or a folder that cannot be sent, is in the result.
    """
    done = Synced()
    stores: dict[Place, Store | IslandError | Exception] = {}
    sweeps: dict[Path, Place] = {}
    for folder in run_folders(root.resolve()):
        where = place or place_of(folder)
        if where is None:
            done.untracked.append(folder.path)
            continue
        sweeps[folder.path.parent] = where
        if up_to_date(folder, where):
            done.known.append(folder.path)
            continue
        try:
            Mirror(folder, _store(stores, where)).send(folder.status())
            done.sent.append(folder.path)
        except Exception as error:  # a store may fail in any way
            done.failed[folder.path] = error
    for path, where in sweeps.items():
        sweep = SweepFolder(path)
        if sweep.read() is None:
            continue
        try:
            status = Status.RUNNING if sweep.at_work() else sweep.status()
            send_sweep(sweep, _store(stores, where), status)
        except Exception as error:
            done.failed[path] = error
    return done


def _store(stores: dict[Place, Any], place: Place) -> Store:
    """The place's store; a place that was away once is not asked again."""
    if place not in stores:
        try:
            stores[place] = Store(place)
        except Exception as error:
            stores[place] = error
    found = stores[place]
    if isinstance(found, Exception):
        raise found
    return found  # type: ignore[no-any-return]
