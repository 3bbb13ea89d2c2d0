"""The last page of a run, with the best robot's replay.

A command in a terminal leaves it to a process that outlives the command. Only the process that has
the folder's lock writes the page, so whoever needs the page waits for the others, and writes it if
nobody has.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep, time
from typing import Final

from islandgp.atomic_files import reading, usable, write_atomic
from islandgp.errors import RunError, UntrustedError, brief
from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.records.lines import stamp
from islandgp.records.locks import locked
from islandgp.records.manifest import add_to_manifest, is_as_written
from islandgp.viewer.champion import champion_replay
from islandgp.viewer.history import RunCurves
from islandgp.viewer.run_page import run_page

LIMIT: Final = 60  # s after which a process that completes a page is stopped
START_LIMIT: Final = 5.0  # s after which such a process has the folder's lock
LOOK_PERIOD: Final = 0.02  # s between two looks for a page
PROGRAM: Final = (
    "import json, sys; sys.path[:], folder = json.loads(sys.argv[1])\n"
    "from islandgp.viewer.last_page import main; main(folder)"
)
"""What the process executes; it imports from the same folders as the command."""


def write_page(
    folder: RunFolder, status: Status, curves: RunCurves | None = None, *, replay: str = ""
) -> None:
    """Writes the page of a run from its folder. Raises RunError.

    Args:
        folder: of the run.
        status: of the run.
        curves: of the run, as in `run_page`.
        replay: of the best robot of a finished run; "" for none.
    """
    summary = folder.path / "summary.json"
    with usable(folder.path), reading("the records of a run", folder.path):
        before = stamp(summary)
        text = run_page(folder, status, curves, replay=replay, now=int(1000 * time()))
        if stamp(summary) == before:  # else the folder has another run now
            write_atomic(folder.path / PAGE, text.encode())
            if status is Status.FINISHED:
                add_to_manifest(folder.path, PAGE)


def replay_or_message(folder: RunFolder) -> str:
    """The replay of the best robot; "" and a message if its episode cannot be recorded.

    A domain of the user may raise any exception when it is observed, or no longer exist.

    Raises:
        UntrustedError: the domain is not trusted.
    """
    try:
        return champion_replay(folder)
    except UntrustedError:
        raise
    except Exception as error:
        print(f"islandgp: no replay of the best robot: {brief(error)}", file=sys.stderr)
        return ""


def complete_page(
    folder: RunFolder,
    curves: RunCurves | None = None,
    *,
    replay: Callable[[RunFolder], str] = replay_or_message,
) -> None:
    """Writes the page of a finished run if it is missing, changed or that of the unfinished run.

    Args:
        folder: of the run.
        curves: of the run, as in `run_page`.
        replay: returns the replay of the best robot.

    Raises:
        RunError: the page cannot be written.
        UntrustedError: the domain is not trusted.
    """
    if is_as_written(folder.path, PAGE):
        return  # without a lock, which a folder that cannot be written does not have
    with usable(folder.path), folder.alone():
        if not is_as_written(folder.path, PAGE):
            write_page(folder, Status.FINISHED, curves, replay=replay(folder))


def start_page(folder: RunFolder) -> bool:
    """Starts a process that completes the page of a finished run; False if it cannot start."""
    task = json.dumps([[*map(os.path.abspath, sys.path)], str(folder.path.absolute())])
    try:
        process = subprocess.Popen(
            (sys.executable, "-c", PROGRAM, task),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # the end of the terminal does not end it
        )
    except OSError:
        return False
    process.returncode = 0  # it is not waited for
    return True


def main(path: str) -> None:
    """Completes the page of a run, given its folder. After an error, `watch` does it."""
    if hasattr(signal, "alarm"):  # not on Windows
        signal.alarm(LIMIT)
    with suppress(RunError):
        complete_page(RunFolder(Path(path)), replay=champion_replay)


def wait_for_page(folder: RunFolder) -> None:
    """Waits for a process that completes a run's page, or that may be starting for it."""
    page, end = folder.path / PAGE, monotonic() + LIMIT
    while folder.finished() and page.exists() and not is_as_written(folder.path, PAGE):
        age = time() - (folder.path / "summary.json").stat().st_mtime
        starting = 0 <= age < START_LIMIT
        if monotonic() > end or not (starting or _is_locked(folder.path)):
            break
        sleep(LOOK_PERIOD)


def _is_locked(folder: Path) -> bool:
    try:
        return locked(folder / ".lock")
    except OSError:  # this process may not lock it
        return False
