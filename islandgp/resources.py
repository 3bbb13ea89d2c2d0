"""Paths of the folders `conf`, `grammar` and `prompts`.

In a checkout they are beside the package, in a wheel inside it.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from islandgp.errors import IslandError

_PACKAGE = Path(__file__).resolve().parent


def program() -> str:
    """The `islandgp` command as this user can give it: by its path where it is not on PATH."""
    script = Path(sys.executable).parent / "islandgp"
    if shutil.which("islandgp") is not None or not script.exists():
        return "islandgp"
    here = Path.cwd()
    return str(script.relative_to(here) if script.is_relative_to(here) else script)


def resource(name: str) -> Path:
    """The folder (or file, by its relative path) of that name.

    A checkout comes first: an editable install can leave stale copies of the
    folders inside the installed package, and those must never be read.

    Raises:
        IslandError: there is no such folder, so the installation is broken.
    """
    checkout = _PACKAGE.parent
    root = checkout if (checkout / "pyproject.toml").is_file() else _PACKAGE
    path = root / name
    if not path.exists():
        raise IslandError(f"Expected {name!r} in {root}, found nothing; install islandgp again.")
    return path
