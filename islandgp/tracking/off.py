"""No tracker: the run's folder is all there is."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel

from islandgp.records.folder import RunFolder, Status


class OffSettings(BaseModel, frozen=True, extra="forbid"):
    """Nothing to choose."""


class Off:
    """Follows nothing."""

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
