"""Sending the last records of a run after its command has ended.

A note beside the SQLite store names the run. The process that sends its records locks the note, and
removes it when the store has all. So a later command finds out if that process did not succeed.
"""

from __future__ import annotations

import os
from contextlib import closing, suppress
from pathlib import Path
from time import sleep, time
from typing import Final, Literal

from islandgp.tracking.store import has_data
from islandgp.tracking.sync_state import read_state

BATCH: Final = ("CI", "SLURM_JOB_ID", "PBS_JOBID", "LSB_JOBID")
"""Variables of environments that end all processes of a job when its last command ends."""

START_LIMIT: Final = 10.0  # s after which a process that sends has locked its note
LOOK_PERIOD: Final = 0.1  # s between two looks for a new store


def command_waits(wait: Literal["auto", True, False]) -> bool:
    """True if a command waits at its end until MLflow has all records.

    Args:
        wait: the setting. With "auto" it does not wait in a terminal, where somebody reads its
            output and types the next command. It waits if a process that it leaves behind could be
            ended: in a container whose first process it is, in a job of a batch system or of
            continuous integration, and on Windows.
    """
    if wait != "auto":
        return wait
    in_terminal = os.isatty(0) and os.isatty(1)
    ends_with_command = os.name != "posix" or os.getpid() == 1 or any(map(os.environ.get, BATCH))
    return ends_with_command or not in_terminal


def seems_usable(file: Path, experiment: str) -> bool:
    """True if a SQLite store seems able to take records; it is tested without MLflow.

    Args:
        file: of the store. A missing or empty one is made later.
        experiment: name of the experiment.

    Returns:
        False if the file is damaged or locked, or the experiment is deleted.
    """
    import sqlite3  # takes time

    if not has_data(file):
        return True
    try:
        with closing(sqlite3.connect(file, timeout=0.2)) as database:
            database.execute("BEGIN IMMEDIATE")  # it can be written
            query = "SELECT lifecycle_stage FROM experiments WHERE name = ?"
            stages = database.execute(query, (experiment,)).fetchall()
    except sqlite3.Error:
        return False
    return stages in ([], [("active",)])


def note_of(file: Path) -> Path:
    """The note beside a SQLite store."""
    return file.with_name(f".{file.stem}.sending")


def lock_note(note: Path, *, blocking: bool) -> int | None:
    """Lock a note until the process ends, or until the returned file is closed.

    Args:
        note: to lock.
        blocking: True: it waits for another process that has the lock.

    Returns:
        The descriptor of the open file; None without a lock.
    """
    with suppress(ImportError, OSError):
        import fcntl  # not on Windows

        descriptor = os.open(note, os.O_RDWR)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if blocking else fcntl.LOCK_NB))
        except OSError:
            os.close(descriptor)
            raise
        return descriptor
    return None


def is_sending(note: Path) -> bool:
    """True if the process of a note is at work, or may be starting."""
    try:
        age = time() - note.stat().st_mtime
    except OSError:  # there is no note
        return False
    descriptor = lock_note(note, blocking=False)
    if descriptor is None:
        return note.exists()
    os.close(descriptor)
    return 0 <= age < START_LIMIT


def left_run(note: Path) -> str | None:
    """The run of a note; removes a note whose process has ended.

    Returns:
        None if there is no note, or its run is complete or deleted. "" if a process still sends the
        run: a loop of commands that do not wait would start more and more of them. Otherwise the
        run's folder, whose process ended before the store had all records.
    """
    if is_sending(note):
        return ""
    try:
        folder = Path(note.read_text(encoding="utf-8").strip())
    except (OSError, ValueError):
        return None
    note.unlink(missing_ok=True)
    state = read_state(folder)
    complete = not folder.is_dir() or (state is not None and state.done != "")
    return None if complete else str(folder)


def store_exists(file: Path) -> bool:
    """True if there is a SQLite store; waits for a process that makes it after its command."""
    while not file.is_file() and is_sending(note_of(file)):
        sleep(LOOK_PERIOD)
    return file.is_file()
