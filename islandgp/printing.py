"""The standard output, which may be full, closed, or in an encoding that lacks characters."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

from islandgp.errors import IslandError

FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO})


@contextmanager
def printed() -> Iterator[None]:
    """What is printed in this context arrives, with `?` for characters that the output lacks.

    Raises:
        IslandError: the output takes no more.
        SystemExit: nobody reads any more, as behind `| head`.
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
        _drop()
        sys.exit(1)
    except OSError as error:
        if error.filename is not None or error.errno not in FULL:
            raise
        _drop()
        raise IslandError(
            f"Expected to write to the standard output, found: {error.strerror}; make room, or"
            " send it elsewhere."
        ) from None


def _drop() -> None:
    """What is not written yet goes nowhere: else the interpreter tries again at its end."""
    with suppress(OSError, ValueError):  # an output without a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
