"""Reports without figures, for tests of what they state in words and numbers."""

from __future__ import annotations

import pytest

from islandgp.compare import figures


@pytest.fixture
def blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures have their titles and captions, but are not drawn."""

    def undrawn(
        key: str, title: str, caption: str, draw: object, **sizes: float
    ) -> figures.Picture:  # as `figures.picture`
        del draw, sizes
        return figures.Picture(key, title, caption, "", b"")

    monkeypatch.setattr(figures, "picture", undrawn)
