"""What a store has got of a folder: remembered in the folder itself, in `tracking.json`."""

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
class Sent:
    """How much of a folder is in which MLflow run."""

    uri: str
    experiment: str
    identity: str  # of the configuration that the MLflow run's parameters tell
    run: str  # MLflow's id
    begun: bool = False  # parameters and configuration are there
    generations: int = 0  # whose metrics are there, >= 0
    done: str = ""  # what the last complete sending was of; "" while something is missing

    def is_in(self, place: Place, identity: str) -> bool:
        """Whether this speaks of that place and that configuration."""
        here = (self.uri, self.experiment, self.identity)
        return here == (place.uri, place.experiment, identity)


def read_sent(folder: Path) -> Sent | None:
    """What the folder remembers; None if nothing was ever sent, or the file is not ours."""
    try:
        return Sent(**validate_json(Sent, (folder / FILE).read_bytes()))
    except (FileNotFoundError, *DECODE_ERRORS):
        return None  # the mirror then asks the store


def write_sent(folder: Path, sent: Sent) -> None:
    """Remembers it."""
    write_atomic(folder / FILE, pretty(asdict(sent)))
