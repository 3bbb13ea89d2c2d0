"""The message for a lack of memory, processes or open files."""

from __future__ import annotations

import errno
from typing import Final

RESOURCE_ERRORS: Final = frozenset({errno.EAGAIN, errno.EMFILE, errno.ENFILE, errno.ENOMEM})
RESOURCE_MESSAGES: Final = (
    "can't start new thread",
    "failed to map segment",
    "cannot allocate memory",
)
"""Parts of messages of other errors in that case, in lower case."""


def shortage(error: BaseException) -> str:
    """The message if an error, or one of its causes, is a lack of resources; else an empty text."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OSError):
            short = cause.errno in RESOURCE_ERRORS
        else:
            named = any(sign in str(cause).lower() for sign in RESOURCE_MESSAGES)
            short = named or isinstance(cause, MemoryError)
        if short:
            return (
                "Expected enough memory, processes and open files for the run, found:"
                f" {str(cause) or 'no more memory'}; raise the limit that is too low"
                " (ulimit -a shows them), or set fewer evaluator.policy.workers, and repeat the"
                " command."
            )
        cause = cause.__cause__ or cause.__context__
    return ""
