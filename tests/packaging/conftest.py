"""The core's wheel and the command line as fixtures."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.architecture.sources import ROOT
from tests.packaging.environments import wheel_of
from tests.trees.conftest import islandgp

__all__ = ["islandgp"]


@pytest.fixture(scope="session")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of `islandgp`, built from this checkout."""
    return wheel_of(ROOT, tmp_path_factory.mktemp("core"))
