"""Writes a run's page during the run and at its end."""

from __future__ import annotations

import sys
from time import monotonic
from typing import Final

from islandgp.errors import RunError
from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.viewer.history import RunCurves
from islandgp.viewer.last_page import complete_page, start_page, write_page

PERIOD: Final = 5.0  # least s between two pages of an unfinished run
SHARE: Final = 0.02  # largest share of a run's time for writing pages


class PageWriter:
    """Writes the page of one run. Errors do not stop the run; the first one is printed."""

    def __init__(self, folder: RunFolder, *, leaves: bool = False) -> None:
        """`leaves`: the last page of a finished run is left to another process."""
        self.curves: RunCurves | None = None  # None: they are read from the folder
        self._folder = folder
        self._leaves = leaves
        self._due = monotonic()
        self._warned = False

    def generation(self) -> None:
        """Writes a new page after a generation, if the last one is old enough."""
        began = monotonic()
        if began < self._due:
            return
        self._try(Status.RUNNING)
        now = monotonic()
        self._due = now + max(PERIOD, (now - began) / SHARE)

    def end(self, status: Status) -> None:
        """Writes the last page, with the best robot's replay if the run is finished."""
        if status is Status.FINISHED and self._leaves and start_page(self._folder):
            return
        if self._folder.begun():
            self._try(status)

    def _try(self, status: Status) -> None:
        try:
            if status is Status.FINISHED:
                complete_page(self._folder, self.curves)
            else:
                write_page(self._folder, status, self.curves)
        except RunError as error:
            if not self._warned:
                self._warned = True
                print(f"islandgp: no new {PAGE}: {error}", file=sys.stderr)
