"""Preloaded by the forkserver, and imported nowhere else.

If a run is stopped while a worker starts, the worker finds its queues closed and ends. This module
suppresses the traceback that it would print.
It also lets the forkserver ignore Ctrl-C from its first import on.
"""

import signal
import sys
from multiprocessing import spawn, synchronize
from traceback import extract_tb
from types import TracebackType


def _report(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    places = {frame.filename for frame in extract_tb(trace)[-1:]}
    is_gone = isinstance(error, (FileNotFoundError, EOFError))
    if not (is_gone and places & {spawn.__file__, synchronize.__file__}):
        sys.__excepthook__(kind, error, trace)


signal.signal(signal.SIGINT, signal.SIG_IGN)
sys.excepthook = _report
