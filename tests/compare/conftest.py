"""Reports without figures, for tests of what they state in words and numbers."""

from __future__ import annotations

import pytest

from islandgp.compare import figures


@pytest.fixture
def blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are not drawn."""
    monkeypatch.setattr(figures, "to_svg", lambda *_, **__: "")
