"""Preloaded by the server that forks workers, and imported nowhere else.

A run that is stopped while a worker starts takes the worker's queues away from it. The worker
ends then, as it should; here it is kept from printing a traceback about it.
"""

import sys
from multiprocessing import spawn, synchronize
from traceback import extract_tb
from types import TracebackType


def _report(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    places = {frame.filename for frame in extract_tb(trace)[-1:]}
    gone = isinstance(error, (FileNotFoundError, EOFError))
    if not (gone and places & {spawn.__file__, synchronize.__file__}):
        sys.__excepthook__(kind, error, trace)


sys.excepthook = _report
