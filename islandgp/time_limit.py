"""A time limit for episodes, which may run a user's code that never returns."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

from islandgp.errors import TimeLimitError
from islandgp.plugin import place_of_frame

RAISE_PERIOD_S: Final = 0.2  # seconds between two `Overdue` if the code caught the first one

MAX_RAISED: Final = 10  # number of `Overdue` that are raised before the process is ended

SLICES: Final = 10
"""Signals until a limit is reached. Those that arrive during a suspension (Ctrl-Z, SIGSTOP) are
delivered as one, so it counts as one part of the limit, however long it is."""

SHORTEST_SLICE_S: Final = 0.005
"""Least seconds between two signals; a shorter limit is noticed after this time."""


class Overdue(BaseException):
    """Raised in code that exceeds its limit. `except Exception` does not catch it."""

    action = ""  # the leaf in which it was raised, "" if unknown


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """A context that limits the time of its block to `seconds`; 0: no limit.

        with time_limit(60):
            domain.run_episode(...)

    The time in which the process is suspended counts as a tenth of the limit at most. The limit
    works in a process's main thread, on systems that have SIGALRM, which nothing else may use;
    elsewhere it does nothing. It cannot interrupt C code that never returns to Python.

    Raises:
        TimeLimitError: at the end of a block that took longer, also if it caught `Overdue`.
    """
    main = threading.current_thread() is threading.main_thread()
    if not seconds or not main or not hasattr(signal, "setitimer"):
        yield
        return
    here, block = sys._getframe(), sys._getframe(2)
    part = max(min(seconds, 1e6) / SLICES, SHORTEST_SLICE_S)
    left = max(1, round(min(seconds, 1e6) / part))  # signals until the limit is reached
    late, function, place = Overdue(), "", ""

    def described() -> str:
        runner = f"the action {late.action}" if late.action else f"the function {function}"
        return f"{runner} still running after {seconds:g} s{place}"

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 -- a handler's
        nonlocal left, function, place
        left -= 1
        if left > 0 or frame is None or frame is here:
            return
        if not function:
            signal.setitimer(signal.ITIMER_REAL, RAISE_PERIOD_S, RAISE_PERIOD_S)
            function, place = frame.f_code.co_name, place_of_frame(frame, block)
        elif left < -MAX_RAISED:
            message = f"islandgp: Expected an end of an episode, found {described()}\n"
            os.write(2, message.encode())
            os._exit(2)
        raise late

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, part, part)
    try:
        yield
    except BaseException as error:
        if not function or isinstance(error, KeyboardInterrupt):
            raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    if function:
        raise TimeLimitError(described(), seconds)
