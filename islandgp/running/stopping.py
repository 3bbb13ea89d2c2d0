"""Signals that end a command as cleanly as Ctrl-C does."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

AGAIN: Final = 0.05
"""Seconds until a signal that was lost comes again."""


@contextmanager
def as_ctrl_c(*names: str) -> Iterator[None]:
    """These signals, by name, raise KeyboardInterrupt while the context lasts, as SIGINT does.

    One that is ignored stays ignored, as under `nohup`; one that the system does not have
    is left out. After a signal an error counts as KeyboardInterrupt: libraries that are
    interrupted may raise one of their own in its place. A signal that comes while a finalizer
    runs, through which Python lets no exception, comes again when that is over.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    asked: KeyboardInterrupt | None = None
    tell = sys.unraisablehook

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 -- a handler's
        nonlocal asked
        asked = KeyboardInterrupt(number)
        raise asked

    def lost(unraisable: sys.UnraisableHookArgs) -> None:
        if asked is None or unraisable.exc_value is not asked:
            tell(unraisable)
            return
        again = threading.Timer(AGAIN, signal.raise_signal, asked.args)
        again.daemon = True
        again.start()

    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    old = {n: signal.getsignal(n) for n in numbers if signal.getsignal(n) is not signal.SIG_IGN}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        old[signal.SIGINT] = signal.default_int_handler
    for number in old:
        signal.signal(number, stop)
    sys.unraisablehook = lost
    try:
        yield
    except Exception as error:
        if asked is not None:
            raise KeyboardInterrupt from error
        raise
    finally:
        sys.unraisablehook = tell
        for number, handler in old.items():
            signal.signal(number, handler)


@contextmanager
def nothing_begun() -> Iterator[None]:
    """Ctrl-C ends the process at once: for imports, in which an exception may be lost."""
    old = signal.getsignal(signal.SIGINT)
    if old is not signal.default_int_handler:  # ignored, or replaced
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 -- a handler's
        os.write(2, b"islandgp: stopped\n")
        os._exit(130)

    signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, old)
