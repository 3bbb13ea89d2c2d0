"""Signals and threads during the start of a command; imports only fast modules."""

from __future__ import annotations

import gc
import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import FrameType
    from typing import NoReturn


def stop_at_once(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 -- a handler's
    """End the process with one line and exit code 130."""
    os.write(2, b"islandgp: stopped\n")
    os._exit(130)


EXIT_LIMIT = 5.0  # s for threads to end after Ctrl-C


def leave(code: object) -> NoReturn:
    """Ends the process with an exit code, as `sys.exit`.

    The last collection of unused objects is left out: it takes a second with those of MLflow.

    After Ctrl-C, a thread may wait for a lock that was never released. The process does not wait
    for it longer than EXIT_LIMIT.
    """
    if code == 130:
        import threading

        watchdog = threading.Timer(EXIT_LIMIT, os._exit, (130,))
        watchdog.daemon = True
        watchdog.start()
    gc.freeze()
    sys.exit(code)  # type: ignore[arg-type]


def stop_before_work(*names: str) -> None:
    """Let Ctrl-C and the named signals end the process immediately, until `as_ctrl_c`.

    For the start of a command: an exception would be lost in an import, or end in a traceback.
    Ignored signals, and signals with a handler, are not changed.
    """
    for name in ("SIGINT", *names):
        number = getattr(signal, name, None)
        if number and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, stop_at_once)


def without_blas_threads() -> None:
    """Keep NumPy and SciPy from starting threads, unless the environment sets their number.

    Such threads spin on the cores of the workers, and results could depend on the number of cores.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def prepare() -> None:
    """Prepare the process of a command, before its imports.

    Python looks for unused objects after 100,000 new ones: after 700 it takes a tenth of a run.
    """
    stop_before_work("SIGTERM", "SIGHUP")
    without_blas_threads()
    gc.set_threshold(100_000)
