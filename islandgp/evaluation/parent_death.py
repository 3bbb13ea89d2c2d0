"""Processes that end with the one that started them, also when that is killed."""

from __future__ import annotations

import os
import signal
import sys
from threading import Thread
from time import sleep
from typing import Final

PERIOD: Final = 0.5  # s between two looks for the parent
PR_SET_PDEATHSIG: Final = 1  # of Linux's prctl


def end_with_parent(parent: int) -> None:
    """Ends this process when its parent is gone; `parent` is the parent's number.

    On Linux the kernel sees to it, whatever this process is doing. A thread looks as well,
    for other systems, and for a parent that was gone before the kernel was asked.
    """
    if os.name != "posix":
        return  # Windows does not tell that a parent is gone
    killed_with_parent()
    Thread(target=_watch, args=(parent,), name="parent", daemon=True).start()


def killed_with_parent() -> None:
    """Asks Linux to kill this process when the thread that started it has ended."""
    if sys.platform == "linux":
        import ctypes  # which other processes need not load

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        sleep(PERIOD)
    os._exit(1)
