"""The folder in which a command is given, as a place to import the user's own parts from."""

from __future__ import annotations

import sys
from pathlib import Path


def import_from_here() -> None:
    """Puts the current folder first, as `python -m islandgp` does and a console script does not.

    The processes that evaluate, and those of launchers, get their paths from this one.
    """
    here = str(Path.cwd())
    if not sys.flags.safe_path and sys.path[0] not in ("", here):
        sys.path.insert(0, here)
