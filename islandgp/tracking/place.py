"""The MLflow store of a command: by its option, or by the configuration of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import ValidationError

from islandgp.atomic_files import damaged
from islandgp.errors import TrackingError
from islandgp.records.folder import RunFolder, run_folders
from islandgp.records.parameters import without_credentials
from islandgp.tracking.store import MLflowSettings, Place
from islandgp.trust import must_trust_server

FACTORY: Final = "islandgp.tracking.mlflow:MLflow"


def place_from(uri: str, experiment: str) -> Place:
    """The store of an address that a user gave. Raises TrackingError."""
    try:
        settings = MLflowSettings(
            uri=uri, artifacts="mlartifacts", experiment=experiment, patience=0
        )
    except ValidationError:
        if not experiment:
            raise TrackingError("Expected the name of an experiment, found none.") from None
        raise TrackingError(
            "Expected a store as sqlite:///FILE or http://HOST:PORT, with a port from 1 to 65535,"
            f" found {without_credentials(uri)!r}."
        ) from None
    return Place.of(settings, Path.cwd())


def place_of(folder: RunFolder) -> Place | None:
    """The store named by a run's configuration; None without tracking.

    Raises:
        RunError, TrackingError: the folder is damaged.
        UntrustedError: only the run names its server.
    """
    tracking, about = folder.configuration().get("tracking"), folder.about()
    if about is None:
        raise damaged("a run", folder.path / "about.json", "missing")
    if not isinstance(tracking, dict) or tracking.get("factory") != FACTORY:
        return None
    try:
        place = Place.of(MLflowSettings.model_validate(tracking.get("policy")), Path(about.home))
    except ValidationError as error:
        wrong = ".".join(map(str, ("policy", *error.errors()[0]["loc"])))
        raise TrackingError(
            f"Expected a store in {folder.path / 'config.yaml'}, found tracking.{wrong} damaged;"
            " delete the run's folder, or give --uri."
        ) from None
    must_trust_server(place.uri)
    return place


def place_of_latest(runs: Path) -> Place:
    """The store of the run that was started last. Raises TrackingError if there is none."""

    def started(folder: RunFolder) -> tuple[float, Path]:
        return (folder.path / "about.json").stat().st_mtime, folder.path

    with_runs = (folder for folder in run_folders(runs) if (folder.path / "about.json").exists())
    for folder in sorted(with_runs, key=started, reverse=True):
        if (place := place_of(folder)) is not None:
            return place
    raise TrackingError(
        f"Expected a tracked run in {runs}, found none; run `python -m islandgp` here first,"
        " or give --uri."
    )
