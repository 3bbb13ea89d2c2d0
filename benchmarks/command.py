"""The command in a separate process, as a user starts it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread, Timer
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
WAIT = 300  # s, longest wait for one command


@contextmanager
def empty_folder() -> Iterator[Path]:
    """A folder for one command; it is gone afterwards."""
    with TemporaryDirectory(prefix="islandgp-bench-") as path:
        yield Path(path)


RUN = ("-m", "islandgp")
TOOL = ("-c", "from islandgp.cli import main; main()")  # what the script `islandgp` does


def start(command: Sequence[str], arguments: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    """RUN or TOOL with WORDS, in a folder; its output is discarded."""
    return subprocess.Popen(
        [sys.executable, *command, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )


def start_in_terminal(arguments: Sequence[str], folder: Path) -> subprocess.Popen[bytes]:
    """RUN with arguments in a pseudo-terminal, as somebody types it; its output is discarded."""
    outside, inside = os.openpty()
    process = subprocess.Popen(
        [sys.executable, *RUN, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=inside,
        stdout=inside,
        stderr=inside,
    )
    os.close(inside)
    Thread(target=_discard, args=(outside,), daemon=True).start()
    return process


def _discard(terminal: int) -> None:
    """Read the output of a terminal until its last process has ended."""
    with suppress(OSError), open(terminal, "rb", buffering=0) as output:
        while output.read(4096):
            pass


def finish(process: subprocess.Popen[Any], expected: int = 0) -> None:
    """Waits for the end; raises RuntimeError where the exit code is another one.

    A command is killed after WAIT. `Popen.wait` with a timeout looks at the process every 50 ms
    only, which would be a part of the measured time.
    """
    killing = Timer(WAIT, process.kill)
    killing.start()
    code = process.wait()
    killing.cancel()
    if code != expected:
        raise RuntimeError(f"{process.args!r} ended with {code}, expected {expected}")


def interrupt(process: subprocess.Popen[str]) -> None:
    """Ctrl-C, and waits for the clean end that follows."""
    process.send_signal(signal.SIGINT)
    try:
        process.wait(timeout=WAIT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        raise
