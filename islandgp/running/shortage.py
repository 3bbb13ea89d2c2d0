"""Errors that mean that the system gives no more memory, processes, threads or files."""

from __future__ import annotations

import errno
from typing import Final

SHORT: Final = frozenset({errno.EAGAIN, errno.EMFILE, errno.ENFILE, errno.ENOMEM})
SIGNS: Final = ("can't start new thread", "failed to map segment", "cannot allocate memory")
"""What errors of other types say in that case, in lower case."""


def shortage(error: BaseException) -> str:
    """The message where an error, or one that led to it, is such a shortage; else \"\"."""
    seen: BaseException | None = error
    while seen is not None:
        if _is_short(seen):
            return (
                "Expected enough memory, processes and open files for the run, found:"
                f" {seen or 'no more memory'}; raise the limit that is too low (ulimit -a shows"
                " them), or take fewer evaluator.policy.workers, and give the command again."
            )
        seen = seen.__cause__ or seen.__context__
    return ""


def _is_short(error: BaseException) -> bool:
    if isinstance(error, OSError):
        return error.errno in SHORT
    return isinstance(error, MemoryError) or any(sign in str(error).lower() for sign in SIGNS)
