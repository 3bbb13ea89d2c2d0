"""The tracker interface: a tracker copies a run's folder to a server in the background."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from pydantic import BaseModel

from islandgp.records.folder import RunFolder, Status


class Tracker(Protocol):
    """Tracks one run. `tests/contracts` checks every implementation.

    A tracker reads the run's folder only, delays the run by no more than its configured patience,
    and does not raise if a server is unreachable. A tracker that can be configured has two more
    class attributes: `Settings`, a pydantic model, and `make(settings, home)`, where `home` is
    the working folder of the command. A third, `check(settings, home)`, is optional: it is called
    before any run starts and raises TrackingError if the tracker cannot store runs.
    """

    def start(self, folder: RunFolder) -> None:
        """Called when a run starts or is resumed.

        Args:
            folder: of the run, open for reading.
        """
        ...

    def generation(self) -> None:
        """Called when the folder has one more generation; returns immediately."""
        ...

    def finish(self, status: Status) -> str:
        """Called when the run has ended.

        Args:
            status: with which it ended.

        Returns:
            A line for the console with the address of the tracked run, or "".
        """
        ...


class OffSettings(BaseModel, frozen=True, extra="forbid"):
    """There are no settings."""


class Off:
    """The tracker that does nothing; the run's folder has all records."""

    Settings = OffSettings

    @classmethod
    def make(cls, settings: OffSettings, home: Path) -> Off:  # noqa: ARG003 -- the protocol's
        """See `Tracker`."""
        return cls()

    def start(self, folder: RunFolder) -> None:
        """See `Tracker`."""

    def generation(self) -> None:
        """See `Tracker`."""

    def finish(self, status: Status) -> str:  # noqa: ARG002 -- the protocol's
        """See `Tracker`."""
        return ""
