"""No tracking: the run's folder has all records."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel

from islandgp.records.folder import RunFolder, Status


class OffSettings(BaseModel, frozen=True, extra="forbid"):
    """There are no settings."""


class Off:
    """Does nothing."""

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
