"""Locks of folders, so that one process writes to a folder at a time."""

from __future__ import annotations

from pathlib import Path

from filelock import FileLock, Timeout

from islandgp.errors import RunError


def take(lock: FileLock, folder: Path, busy: RunError) -> None:
    """Creates a folder and acquires its lock. Raises `busy` if another process holds it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        # `locked` of another process may hold it for a moment.
        lock.acquire(timeout=1, poll_interval=0.05)
    except Timeout:
        raise busy from None


def locked(path: Path) -> bool:
    """True if a process holds the lock file."""
    if not path.exists():
        return False
    try:
        with FileLock(path, timeout=0):
            return False
    except Timeout:
        return True
