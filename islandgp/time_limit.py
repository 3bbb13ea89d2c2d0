"""A time limit for episodes, which may run a user's code that never returns."""

from __future__ import annotations

import os
import signal
import threading
from inspect import currentframe
from time import monotonic
from types import FrameType, TracebackType
from typing import Any, Final

from islandgp.errors import TimeLimitError
from islandgp.plugin import place_of_frame

RAISE_PERIOD_S: Final = 0.2
"""Seconds between two `Overdue` if the code caught the first one."""

MAX_RAISED: Final = 10
"""Number of `Overdue` that are raised before the process is ended."""

SLICES: Final = 10
"""Signals until a limit is reached. Those that arrive during a suspension (Ctrl-Z, SIGSTOP) are
delivered as one, so it counts as one part of the limit, however long it is."""

SHORTEST_SLICE_S: Final = 0.005
"""Least seconds between two signals; a shorter limit is noticed after this time."""


class Overdue(BaseException):
    """Raised in code that exceeds its limit. `except Exception` does not catch it."""

    action = ""  # the leaf in which it was raised, "" if unknown


class TimeLimit:
    """A context that limits the time of its block to `seconds`; 0: no limit.

        with TimeLimit(60):
            domain.run_episode(...)

    The time in which the process is suspended counts as a tenth of the limit at most. The limit
    works in a process's main thread, on systems that have SIGALRM; elsewhere it does nothing. It
    cannot interrupt C code that never returns to Python. At the end, the handler and the timer of
    SIGALRM are restored.

    Raises:
        TimeLimitError: at the end of a block that took longer, also if it caught `Overdue`.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = min(seconds, 1e6)
        self._slice = max(self._seconds / SLICES, SHORTEST_SLICE_S)
        self._signals = 0  # number of those received
        self._most = max(1, round(self._seconds / self._slice))  # until the limit is reached
        self._late: Overdue | None = None  # the first one
        self._function = self._where = ""  # the function that was running then, and its line
        self._over = True
        self._entered: FrameType | None = None
        self._before: tuple[float, Any, tuple[float, float]] | None = None

    def __enter__(self) -> None:
        main = threading.current_thread() is threading.main_thread()
        if not self._seconds or not main or not hasattr(signal, "setitimer"):
            return
        self._entered = _caller()
        handler = signal.signal(signal.SIGALRM, self._stop)
        timer = signal.setitimer(signal.ITIMER_REAL, self._slice, self._slice)
        self._before = (monotonic(), handler, timer)
        self._over = False  # last, as no `__exit__` follows an exception that is raised here

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._over = True
        self._entered = None
        if self._before is None:
            return
        start, handler, (remaining, interval) = self._before
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL if handler is None else handler)
        if remaining:
            remaining = max(remaining - (monotonic() - start), 0.001)
            signal.setitimer(signal.ITIMER_REAL, remaining, interval)
        if self._late is None or (kind is not None and issubclass(kind, KeyboardInterrupt)):
            return
        raise TimeLimitError(self._description(), self._seconds) from None

    def _description(self) -> str:
        assert self._late is not None
        runner = f"the action {self._late.action}" if self._late.action else self._function
        return f"{runner} still running after {self._seconds:g} s{self._where}"

    def _stop(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002 -- a handler's
        if frame is not None and frame.f_code in _OWN_CODE:
            return  # an exception at the end of the block would leave the timer running
        self._signals += 1
        if self._over or self._signals < self._most:
            return
        if self._late is None:
            signal.setitimer(signal.ITIMER_REAL, RAISE_PERIOD_S, RAISE_PERIOD_S)
            self._where = place_of_frame(frame, self._entered)
            self._function = f"the function {frame.f_code.co_name}" if frame is not None else "it"
            self._late = Overdue()
            raise self._late
        if self._signals > self._most + MAX_RAISED:
            os.write(
                2,
                f"islandgp: Expected an end of an episode, found {self._description()}\n".encode(),
            )
            os._exit(2)
        raise Overdue


_OWN_CODE: Final = {TimeLimit.__exit__.__code__, TimeLimit._stop.__code__}
"""Code in which a signal raises nothing."""


def _caller() -> FrameType | None:
    """The frame that enters the context."""
    frame = currentframe()
    return frame and frame.f_back and frame.f_back.f_back
