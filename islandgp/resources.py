"""Paths of the folders `conf`, `grammar` and `prompts`.

In a checkout they are next to the package; in a wheel they are inside it.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from islandgp.errors import IslandError

_PACKAGE = Path(__file__).resolve().parent


def program() -> str:
    """The name of the `islandgp` command, or its path if it is not on PATH."""
    script = Path(sys.executable).parent / "islandgp"
    if shutil.which("islandgp") is not None or not script.exists():
        return "islandgp"
    here = Path.cwd()
    return str(script.relative_to(here) if script.is_relative_to(here) else script)


def resource(name: str) -> Path:
    """The path of a folder, or of a file given by its relative path.

    A checkout takes precedence, because an editable install may leave stale copies of the folders
    inside the installed package.

    Raises:
        IslandError: there is no such folder, so the installation is broken.
    """
    checkout = _PACKAGE.parent
    root = checkout if (checkout / "pyproject.toml").is_file() else _PACKAGE
    path = root / name
    if not path.exists():
        raise IslandError(f"Expected {name!r} in {root}, found nothing; install islandgp again.")
    return path
