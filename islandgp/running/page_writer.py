"""Writes a run's page during the run and at its end."""

from __future__ import annotations

import sys
from pathlib import Path
from time import monotonic, time
from typing import Final

from islandgp.atomic_files import reading, usable, write_atomic
from islandgp.errors import RunError, brief
from islandgp.records.folder import RunFolder, Status
from islandgp.records.manifest import add_to_manifest
from islandgp.viewer.champion import champion_replay
from islandgp.viewer.history import RunCurves
from islandgp.viewer.run_page import NAME_OF_PAGE, run_page

PERIOD: Final = 5.0  # least s between two pages of an unfinished run
SHARE: Final = 0.02  # largest share of a run's time for writing pages


class PageWriter:
    """Writes the page of one run. Errors do not stop the run; the first one is printed."""

    def __init__(self, folder: RunFolder) -> None:
        self.curves: RunCurves | None = None  # None: they are read from the folder
        self._folder = folder
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
        if self._folder.begun():
            self._try(status)

    def _try(self, status: Status) -> None:
        try:
            write_page(self._folder, status, self.curves)
        except RunError as error:
            if not self._warned:
                self._warned = True
                print(f"islandgp: no new {NAME_OF_PAGE}: {error}", file=sys.stderr)


def write_page(folder: RunFolder, status: Status, curves: RunCurves | None = None) -> Path:
    """Writes the page of a run from its folder; returns its path. Raises RunError.

    `curves`: of the run, as in `run_page`.
    """
    path = folder.path / NAME_OF_PAGE
    with usable(folder.path), reading("the records of a run", folder.path):
        replay = _replay(folder) if status is Status.FINISHED else ""
        text = run_page(folder, status, curves, replay=replay, now=int(1000 * time()))
        write_atomic(path, text.encode())
        if status is Status.FINISHED:
            add_to_manifest(folder.path, path.name)
    return path


def _replay(folder: RunFolder) -> str:
    """The replay of the best robot; "" if its episode cannot be recorded.

    A domain of the user may raise any exception when it is observed, or no longer exist.
    """
    try:
        return champion_replay(folder)
    except Exception as error:
        print(f"islandgp: no replay of the best robot: {brief(error)}", file=sys.stderr)
        return ""
