"""Setup of the whole test suite: markers, fixtures and Hypothesis's profile."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from typing import Final

import hypothesis
import pytest

from islandgp.gate import set_user_folder
from islandgp.tracking.mlflow import sender
from islandgp.viewer import run_page as page_file
from tests import caches, profiles  # noqa: F401 (it registers the profiles)

hypothesis.settings.load_profile("quick")

# Processes that tests start write .pyc files, as an installed package does.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

caches.install()
os.fsync = lambda _: None  # files of tests need not survive a power cut

gc.disable()  # while tests are collected: millions of objects, none of them garbage


MARKERS: Final = {
    "process": "starts a process or a browser, or opens a store of MLflow",
    "packaging": "builds and installs the wheel",
    "slow": "long or exhaustive: `make test-slow`, nightly",
    "replay": "the page of a run has the replay of its best robot",
}
STORES: Final = {"browser", "home", "prepared", "server", "store", "template"}
"""Fixtures whose tests are marked `process`."""


def pytest_configure(config: pytest.Config) -> None:
    """Tests marked `slow` run only when `-m` asks for them: `pytest -m slow`."""
    for name, meaning in MARKERS.items():
        config.addinivalue_line("markers", f"{name}: {meaning}")
    if not config.option.markexpr:
        config.option.markexpr = "not slow"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks tests that use a browser or a store, before `-m` selects by marks."""
    for item in items:
        if isinstance(item, pytest.Function) and not STORES.isdisjoint(item.fixturenames):
            item.add_marker("process")


def pytest_collection_finish() -> None:
    """Excludes the modules from garbage collection, which would take a tenth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)  # not 700: tests leave little behind
    gc.enable()


@pytest.fixture(autouse=True)
def _no_replay(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Skips the replay of the best robot's episode, which takes longer than a small run."""
    if request.node.get_closest_marker("replay") is None:
        monkeypatch.setattr(page_file, "champion_replay", lambda *_: "")


@pytest.fixture(autouse=True)
def _own_sender() -> Iterator[None]:
    """Each test has a thread of its own for MLflow, as that of another may wait for a server.

    And no folder of configuration of another test.
    """
    yield
    sender.cache_clear()
    set_user_folder(None)


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # Shells start background jobs with SIGINT ignored; tests of Ctrl-C need the handler.
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    # `nohup` starts its command with SIGHUP ignored; tests of a closed terminal send it.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
