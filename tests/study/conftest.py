"""Reports without figures, for tests of what they state in words and numbers."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from islandgp.study.figures import drawing


@pytest.fixture(scope="module")
def blank_module() -> Iterator[None]:
    """Figures of the module's fixtures are drawn but not rendered, which takes most of a report."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)
        yield


@pytest.fixture
def blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures have their titles and captions, but are not drawn."""

    def undrawn(
        key: str, draw: object, *, layout: object = None, **values: object
    ) -> drawing.Picture:  # as `drawing.picture`
        del draw, layout
        return drawing.Picture(key, *drawing.title_and_caption(key, **values), "", b"")

    monkeypatch.setattr(drawing, "picture", undrawn)
