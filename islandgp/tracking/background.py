"""Sending the last records of a run after its command has ended."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal

BATCH: Final = ("CI", "SLURM_JOB_ID", "PBS_JOBID", "LSB_JOBID")
"""Variables of environments that end all processes of a job when its last command ends."""


def command_waits(wait: bool | Literal["auto"]) -> bool:
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


def lock_sending(home: Path) -> int | None:
    """Lock a working folder for the process that sends in the background.

    The lock is on the folder itself and leaves no file.

    Args:
        home: folder in which the command was given.

    Returns:
        The open folder; closing it, or the end of the process, releases the lock. None if another
        process has the lock, or the file system has no locks.
    """
    with suppress(ImportError, OSError):
        import fcntl  # not on Windows

        folder = os.open(home, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(folder)
            raise
        return folder
    return None


def can_send(home: Path) -> bool:
    """True unless a process already sends in the background for this folder.

    A loop of commands on a busy machine would otherwise start more and more of them.
    """
    folder = lock_sending(home)
    if folder is not None:
        os.close(folder)
    return folder is not None
