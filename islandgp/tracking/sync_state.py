"""The sync state of a run's folder, stored in its `tracking.json`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from islandgp.atomic_files import write_atomic
from islandgp.plain import DECODE_ERRORS, validate_json
from islandgp.records.files import pretty
from islandgp.tracking.store import Place

FILE: Final = "tracking.json"
LOCK: Final = ".tracking.lock"


@dataclass(frozen=True, slots=True)
class SyncState:
    """An MLflow run, and how much of a folder it has."""

    uri: str
    experiment: str
    identity: str  # digest of the configuration in the MLflow run's parameters
    run: str  # MLflow's id
    begun: bool = False  # True: it has parameters and configuration
    generations: int = 0  # number of generations whose metrics it has, >= 0
    done: str = ""  # status and number of generations when everything was sent; "" before

    def is_in(self, place: Place, identity: str) -> bool:
        """True if the MLflow run is in that place, with that configuration."""
        location = (self.uri, self.experiment, self.identity)
        return location == (place.uri, place.experiment, identity)


def read_state(folder: Path) -> SyncState | None:
    """The state of a folder; None if nothing was sent, or the file is damaged."""
    try:
        return SyncState(**validate_json(SyncState, (folder / FILE).read_bytes()))
    except (FileNotFoundError, *DECODE_ERRORS):
        return None  # the uploader asks the store


def write_state(folder: Path, state: SyncState) -> None:
    """Write the state of a folder."""
    write_atomic(folder / FILE, pretty(asdict(state)))
