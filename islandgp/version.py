"""Which code a run was made with."""

from __future__ import annotations

import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def code_version() -> str:
    """The package's version and, in a checkout, its commit: `0.1.0+6ba196d8d3f1-dirty`."""
    try:
        release = version("islandgp")
    except PackageNotFoundError:  # run from a checkout that was never installed
        release = "0"
    commit = _commit(Path(__file__).resolve().parent.parent)
    return f"{release}+{commit}" if commit else release


def _commit(checkout: Path) -> str:
    if not (checkout / ".git").exists():
        return ""
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            cwd=checkout,
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return found.stdout.strip()
