"""The command line as a fixture."""

from __future__ import annotations

import pytest

from tests.trees.shell import Cli, shell


@pytest.fixture
def islandgp(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `islandgp ARGUMENTS...`; see `shell`."""
    return shell(monkeypatch, capsys)
