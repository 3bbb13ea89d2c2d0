"""A clock that is wrong: first on PYTHONPATH, it shifts `time` by the number in a file, s."""

import os
import time
from pathlib import Path

_shift = Path(os.environ["CLOCK_SHIFT"])
_time, _time_ns = time.time, time.time_ns

time.time = lambda: _time() + float(_shift.read_text())
time.time_ns = lambda: _time_ns() + int(1e9 * float(_shift.read_text()))
