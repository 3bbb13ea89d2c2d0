"""The last page of a run, with the best robot's replay.

A command in a terminal leaves it to a process that outlives the command. The hidden file MARKER has
the id of that process until the page is complete. Whoever needs the page waits for the process, and
writes the page if there is none.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from time import sleep, time
from typing import Final

from islandgp.atomic_files import reading, usable, write_atomic
from islandgp.errors import RunError, brief
from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.records.manifest import add_to_manifest, is_as_written
from islandgp.trust import must_have_no_links, trust, trusted
from islandgp.viewer.champion import champion_replay
from islandgp.viewer.history import RunCurves
from islandgp.viewer.run_page import run_page

MARKER: Final = ".page"
LIMIT: Final = 60.0  # s after which nobody waits for the process of a marker
LOOK_PERIOD: Final = 0.02  # s between two looks at a marker
MAX_DIGITS: Final = 20  # of a process id


def write_page(folder: RunFolder, status: Status, curves: RunCurves | None = None) -> Path:
    """Writes the page of a run from its folder; returns its path. Raises RunError.

    `curves`: of the run, as in `run_page`.
    """
    path = folder.path / PAGE
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


def complete_page(folder: RunFolder) -> Path:
    """The page of a finished run; it is written if it is missing, changed or of the unfinished run.

    Raises:
        RunError: it cannot be written.
    """
    wait_for_page(folder.path)
    if is_as_written(folder.path, PAGE):
        return folder.path / PAGE
    return write_page(folder, Status.FINISHED)


def start_page(folder: RunFolder) -> bool:
    """Starts a process that completes the page of a finished run; False if it cannot start."""
    task = json.dumps([str(folder.path.absolute()), sorted(trusted())])
    try:
        process = subprocess.Popen(
            (sys.executable, "-P", "-m", "islandgp.viewer.last_page", task),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            # The process imports from the same folders as this one.
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))},
            start_new_session=True,  # the end of the terminal does not end it
        )
        (folder.path / MARKER).write_text(str(process.pid), encoding="ascii")
    except OSError:
        return False
    process.returncode = 0  # it is not waited for
    return True


def wait_for_page(folder: Path) -> None:
    """Waits for the process that completes a run's page, if there is one."""
    marker = folder / MARKER
    while _is_at_work(marker):
        sleep(LOOK_PERIOD)


def _is_at_work(marker: Path) -> bool:
    """True if the process of a marker is at work; anybody may have written the marker."""
    try:
        if not (marker.is_file() and 0 <= time() - marker.lstat().st_mtime < LIMIT):
            return False
        with marker.open("rb") as file:
            number = int(file.read(MAX_DIGITS))
        os.kill(number, 0)
    except PermissionError:  # a process of another user
        return True
    except (OSError, ValueError, OverflowError):
        return False
    return True


def main() -> None:
    """Completes the page of the run whose folder and trusted names are in the argument."""
    path, names = json.loads(sys.argv[1])
    folder = RunFolder(Path(path))
    marker = folder.path / MARKER
    trust(names)
    try:
        must_have_no_links(folder.path)
        with suppress(RunError):  # `islandgp watch` tries again and shows the error
            if not is_as_written(folder.path, PAGE):
                write_page(folder, Status.FINISHED)
    finally:
        with suppress(OSError):
            marker.unlink()


if __name__ == "__main__":
    main()
