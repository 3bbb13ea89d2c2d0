"""Sending the last records of a run after its command has ended.

A note beside the SQLite store names the run. The process that sends its records locks the note, and
removes it when the store has all. So a later command finds out if that process did not succeed.
"""

from __future__ import annotations

import os
from contextlib import closing, suppress
from pathlib import Path
from time import sleep, time
from typing import Final

from islandgp.errors import UntrustedError
from islandgp.tracking.store import has_data
from islandgp.tracking.sync_state import read_state
from islandgp.trust import must_have_no_links

START_LIMIT: Final = 10.0  # s after which a process that sends has locked its note
LOOK_PERIOD: Final = 0.1  # s between two looks for a new store
MAX_NOTE: Final = 10_000  # bytes; longer than any path


def seems_usable(file: Path, experiment: str) -> bool:
    """True if a SQLite store seems able to take records; it is tested without MLflow.

    Args:
        file: of the store. A missing or empty one is made later.
        experiment: name of the experiment.

    Returns:
        False if the file is damaged or locked, or the experiment is deleted.
    """
    import sqlite3  # takes time

    try:
        if not has_data(file):
            return True
        with closing(sqlite3.connect(file, timeout=0.2)) as database:
            database.execute("BEGIN IMMEDIATE")  # it can be written
            query = "SELECT lifecycle_stage FROM experiments WHERE name = ?"
            stages = database.execute(query, (experiment,)).fetchall()
    except (OSError, sqlite3.Error):
        return False
    return stages in ([], [("active",)])


def note_of(file: Path) -> Path:
    """The note beside a SQLite store."""
    return file.with_name(f".{file.name}.sending")


def write_note(note: Path, folder: Path) -> bool:
    """Write a note with the path of a run's folder; returns True if it was written.

    Another file in its place, or a link to one, is not changed.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL  # follows no link
    with suppress(OSError), os.fdopen(os.open(note, flags, 0o666), "wb") as file:
        file.write(os.fsencode(folder.absolute()) + b"\n")
        return True
    return False


def lock_note(note: Path, *, blocking: bool) -> int:
    """Lock a note until the process ends, or until the returned descriptor is closed.

    Args:
        note: to lock.
        blocking: True: it waits for another process that has the lock.

    Raises:
        BlockingIOError: another process has the lock.
        ImportError, OSError: the file cannot be locked.
    """
    import fcntl  # not on Windows

    descriptor = os.open(note, os.O_RDWR | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if blocking else fcntl.LOCK_NB))
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def is_sending(note: Path) -> bool:
    """True if the process of a note is at work, or may be starting."""
    try:
        age = time() - note.lstat().st_mtime
    except OSError:  # there is no note
        return False
    try:
        os.close(lock_note(note, blocking=False))
    except BlockingIOError:
        return True
    except (ImportError, OSError):  # it is no file, or that of another user
        pass
    return 0 <= age < START_LIMIT


def left_run(note: Path) -> str | None:
    """The run of a note; removes a note whose process has ended.

    Returns:
        None if there is no note, or its run is complete or deleted, or it names no run. "" if a
        process still sends the run: a loop of commands that do not wait would start more and more
        of them. Otherwise the run's folder, whose process ended before the store had all records.
    """
    if is_sending(note):
        return ""
    text = _text_of(note)
    with suppress(OSError):  # a folder
        note.unlink()
    return text if _is_incomplete(text) else None


def _text_of(note: Path) -> str:
    """The path in a note; "" if it cannot be read."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with suppress(OSError), os.fdopen(os.open(note, flags), "rb") as file:
        return os.fsdecode(file.read(MAX_NOTE)).removesuffix("\n")
    return ""


def _is_incomplete(path: str) -> bool:
    """True if a path is that of a run whose store may lack records."""
    folder = Path(path)
    if not (path.isprintable() and folder.is_absolute()):  # anybody can write a note
        return False
    with suppress(OSError, UntrustedError):
        must_have_no_links(folder)
        if (folder / "about.json").is_file():
            state = read_state(folder)
            return state is None or state.done == ""
    return False


def store_exists(file: Path) -> bool:
    """True if there is a SQLite store; waits for a process that makes it after its command."""
    while not file.is_file() and is_sending(note_of(file)):
        sleep(LOOK_PERIOD)
    return file.is_file()
