"""A browser, and the page of an episode, for all tests of the viewer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from islandgp.viewer.page import page
from tests.viewer.browser import Browser, chromium
from tests.viewer.episodes import recorded


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One Chromium for all tests of a worker."""
    program = chromium()
    if program is None:
        pytest.skip("no Chromium is installed (apt-get install chromium)")
    with Browser(program, tmp_path_factory.mktemp("profile")) as chromium_browser:
        yield chromium_browser


@pytest.fixture(scope="session")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the all-rounder's episode."""
    path = tmp_path_factory.mktemp("page") / "replay.html"
    path.write_text(page(recorded(), title="All-rounder"), encoding="utf-8")
    return path


@pytest.fixture
def sized(browser: Browser) -> Iterator[Callable[[int, int], None]]:
    """Sets the size of the window; afterwards it is as before."""

    def resize(width: int, height: int) -> None:
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    yield resize
    browser.call("Emulation.clearDeviceMetricsOverride")
