"""The scripts of `docs` that write the site's pages, as modules."""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType

from tests.running.commands import ROOT


def script(name: str) -> ModuleType:
    """docs/NAME.py."""
    folder = str(ROOT / "docs")
    sys.path.insert(0, folder)
    try:
        return import_module(name)
    finally:
        sys.path.remove(folder)
