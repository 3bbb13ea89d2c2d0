"""A time limit for episodes, which may run a user's code that never returns."""

from __future__ import annotations

import os
import signal
import threading
from inspect import currentframe
from time import monotonic, process_time
from types import FrameType, TracebackType
from typing import Any, Final

from islandgp.errors import TimeLimitError
from islandgp.plugin import place_of_frame

RAISE_PERIOD_S: Final = 0.2
"""Seconds between two `Overdue` if the code caught the first one."""

MAX_RAISED: Final = 10
"""Number of `Overdue` that are raised before the process is ended."""

SLICES: Final = 10
"""Parts of a limit. A suspension (Ctrl-Z, SIGSTOP) counts as one part, however long it is."""

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
        self._used = 0.0  # s
        self._clocks = (0.0, 0.0)  # s: the time and the process's CPU time when `_used` was counted
        self._times = 0  # number of `Overdue` that were raised
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
        self._clocks = (monotonic(), process_time())
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
        if self._over or (not self._late and not self._is_late()):
            return
        self._times += 1
        if self._late is None:
            self._where = place_of_frame(frame, self._entered)
            self._function = f"the function {frame.f_code.co_name}" if frame is not None else "it"
            self._late = Overdue()
            raise self._late
        if self._times > MAX_RAISED:
            os.write(
                2,
                f"islandgp: Expected an end of an episode, found {self._description()}\n".encode(),
            )
            os._exit(2)
        raise Overdue

    def _is_late(self) -> bool:
        """Count the time since the last call; True if the limit is reached.

        Signals that arrive during a suspension are delivered as one when it ends.
        """
        wall, cpu = self._clocks
        self._clocks = now, busy = monotonic(), process_time()
        self._used += min(now - wall, max(self._slice, busy - cpu))
        if self._used < self._seconds - self._slice / 2:
            return False
        signal.setitimer(signal.ITIMER_REAL, RAISE_PERIOD_S, RAISE_PERIOD_S)
        return True


_OWN_CODE: Final = {
    method.__code__ for method in (TimeLimit.__exit__, TimeLimit._stop, TimeLimit._is_late)
}
"""Code in which a signal raises nothing."""


def _caller() -> FrameType | None:
    """The frame that enters the context."""
    frame = currentframe()
    return frame and frame.f_back and frame.f_back.f_back
