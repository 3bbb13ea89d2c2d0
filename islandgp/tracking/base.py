"""The seam to experiment trackers: they mirror a run's folder, from behind."""

from __future__ import annotations

from typing import Protocol

from islandgp.records.folder import RunFolder, Status


class Tracker(Protocol):
    """Follows one run. `tests/contracts` holds what every implementation promises.

    It reads the folder and nothing else, never delays the run beyond its stated
    patience, and never raises because a server is away. A tracker that
    configuration can choose has two class attributes more: `Settings`, a
    pydantic model, and `make(settings, home)` with the folder in which the
    command was given. It may have a third: `ready(settings, home)` is called before
    anything starts, and raises TrackingError where it could never keep a run.
    """

    def start(self, folder: RunFolder) -> None:
        """A run begins, or goes on; the folder is open."""
        ...

    def generation(self) -> None:
        """The folder holds one more generation; returns at once."""
        ...

    def finish(self, status: Status) -> str:
        """The run is over; returns a line that tells the user where to look, or ""."""
        ...
