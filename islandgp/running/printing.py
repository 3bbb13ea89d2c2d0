"""Output to standard streams that may be full, closed, or lack characters in their encoding.

The standard output has results, so a failed write is an error. The error stream has messages about
progress, so a failed write is ignored.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, TextIO

from islandgp.errors import IslandError

FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})


@contextmanager
def checked_stdout() -> Iterator[None]:
    """Context that flushes the standard output; `?` replaces characters that it cannot encode.

    Raises:
        IslandError: the output cannot be written, e.g. because the disk is full.
        SystemExit: the reader of the output has ended, e.g. `| head`.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        _drop(sys.stdout)
        sys.exit(1)
    except OSError as error:
        if error.filename is not None or error.errno not in FULL:
            raise
        _drop(sys.stdout)
        raise IslandError(
            f"Expected to write to the standard output, found: {error.strerror}; make room, or"
            " send it elsewhere."
        ) from None


def _drop(stream: TextIO) -> None:
    """Drops unwritten output, which the interpreter would try to write again at its exit."""
    with suppress(OSError, ValueError):  # a stream without a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def echo(text: str) -> None:
    """Prints text that is also stored elsewhere; an output without a reader is no error."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _drop(sys.stdout)


class Display:
    """An error stream that never fails: text that cannot be written is dropped."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write text, or drop it if the stream is broken; returns len(text)."""
        try:
            return self._stream.write(text)
        except (OSError, ValueError):  # ValueError: it is closed
            self._lose()
            return len(text)

    def flush(self) -> None:
        """Flush the stream, or drop the text if it is broken."""
        try:
            self._stream.flush()
        except (OSError, ValueError):
            self._lose()

    def __getattr__(self, name: str) -> Any:
        """Any other attribute is that of the stream."""
        return getattr(self._stream, name)

    def _lose(self) -> None:
        """Drop all further text."""
        _drop(self._stream)
        self._stream = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 -- until the end


@contextmanager
def tolerant_stderr() -> Iterator[None]:
    """Context in which the error stream is a `Display`, also if there was no error stream."""
    _fill_standard_files()
    before = sys.stderr
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        display: Any = Display(before or nowhere)
        sys.stderr = display
        try:
            yield
        finally:
            display.flush()
            if sys.stderr is display:  # it may have been replaced
                sys.stderr = before


def _fill_standard_files() -> None:
    """Opens file descriptors 0 to 2 if they are closed, so that no other file gets them."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free descriptor
