"""Signals that end a command as Ctrl-C does."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

from islandgp.startup import stop_at_once

RETRY_S: Final = 0.05
"""Seconds after which a lost signal is raised again."""


@contextmanager
def as_ctrl_c(*names: str) -> Iterator[None]:
    """Context in which these signals raise KeyboardInterrupt, as SIGINT does.

    Ignored signals stay ignored, as under `nohup`; signals that the system does not have are
    skipped. After a signal any error is replaced by KeyboardInterrupt, because interrupted
    libraries may raise errors of their own. A signal during a finalizer, where Python drops
    exceptions, is raised again after RETRY_S seconds.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    interrupt: KeyboardInterrupt | None = None
    old_hook = sys.unraisablehook

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 -- a handler's
        nonlocal interrupt
        interrupt = KeyboardInterrupt(number)
        raise interrupt

    def lost(unraisable: sys.UnraisableHookArgs) -> None:
        if interrupt is None or unraisable.exc_value is not interrupt:
            old_hook(unraisable)
            return
        timer = threading.Timer(RETRY_S, signal.raise_signal, interrupt.args)
        timer.daemon = True
        timer.start()

    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    old = {n: signal.getsignal(n) for n in numbers if signal.getsignal(n) is not signal.SIG_IGN}
    if signal.getsignal(signal.SIGINT) in (signal.default_int_handler, stop_at_once):
        old[signal.SIGINT] = signal.getsignal(signal.SIGINT)
    for number in old:
        signal.signal(number, stop)
    sys.unraisablehook = lost
    try:
        yield
    except Exception as error:
        if interrupt is not None:
            raise KeyboardInterrupt from error
        raise
    finally:
        sys.unraisablehook = old_hook
        for number, handler in old.items():
            signal.signal(number, handler)
