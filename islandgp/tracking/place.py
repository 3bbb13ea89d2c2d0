"""The MLflow stores of a command. They come from its options and the user's configuration.

A run's configuration only chooses one of them, by its address and experiment.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from islandgp.errors import TrackingError, UntrustedError
from islandgp.gate import cleaned
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import without_credentials
from islandgp.tracking.store import MLflowSettings, Place, configured_name

FACTORY: Final = "islandgp.tracking.mlflow:MLflow"


def place_from(uri: str, experiment: str) -> Place:
    """The store of an address that a user gave; a file has its artifacts beside it.

    Raises TrackingError.
    """
    try:
        settings = MLflowSettings(
            uri=uri, artifacts="mlartifacts", experiment=experiment, patience=0
        )
    except ValidationError:
        if not experiment:
            raise TrackingError("Expected the name of an experiment, found none.") from None
        raise TrackingError(
            "Expected a store as sqlite:///FILE or http://HOST:PORT, with a port from 1 to 65535,"
            f" found {cleaned(without_credentials(uri))!r}."
        ) from None
    file = Place.of(settings, Path.cwd()).file
    return Place.of(settings, Path.cwd() if file is None else file.parent)


def place_of(folder: RunFolder, places: Iterable[Place]) -> Place | None:
    """The one of the user's stores that a run's configuration names; None without tracking.

    Raises:
        RunError: the folder is damaged.
        UntrustedError: it names another store.
    """
    tracking = folder.configuration().get("tracking")
    if not isinstance(tracking, dict) or tracking.get("factory") != FACTORY:
        return None
    params = tracking.get("policy")
    params = params if isinstance(params, dict) else {}
    name = configured_name(str(params.get("uri")), str(params.get("experiment")))
    for place in places:
        if place.configured == name:
            return place
    uri, experiment = name
    raise UntrustedError(
        f"Expected a store that your own command or configuration names, found {uri} with"
        f" experiment {experiment}, which only the run names; give --uri and --experiment, or"
        " --config-dir FOLDER with a file tracking/NAME.yaml."
    )
