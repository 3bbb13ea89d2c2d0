"""Figures without ink, for tests of what reports say in words and numbers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module")
def blank_module() -> Iterator[None]:
    """Figures of the module's fixtures are drawn but not rendered, which takes most of a report."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)
        yield


@pytest.fixture
def blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `blank_module`, in one test."""
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)
