"""What holds for the whole test suite: which tests run, and how Hypothesis searches."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from threading import Thread

import hypothesis
import pytest

from islandgp.running import page_writer
from islandgp.tracking import mlflow
from islandgp.tracking.sender import Order, Tell, Worker
from tests import once

# `quick` tries the same examples in every run, so that a red test stays red until it is mended.
# `nightly` (make test-slow) tries others, and five times as many.
hypothesis.settings.register_profile("quick", deadline=None, derandomize=True, database=None)
hypothesis.settings.register_profile("nightly", deadline=None)
hypothesis.settings.load_profile("quick")

# Processes that tests start keep what they have compiled, as an installed package does.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

once.install()


def pytest_configure(config: pytest.Config) -> None:
    """Tests marked `slow` run only when `-m` asks for them: `pytest -m slow`."""
    config.addinivalue_line("markers", "slow: exhaustive, takes longer than a second")
    config.addinivalue_line("markers", "replay: the run's page holds the champion's replay")
    if not config.option.markexpr:
        config.option.markexpr = "not slow"


def pytest_collection_finish() -> None:
    """Modules stay until the end: looking for garbage among them takes a tenth of the time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _no_replay(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs end without playing their champion's episode, which takes longer than a small run."""
    if request.node.get_closest_marker("replay") is None:
        monkeypatch.setattr(page_writer, "champion_replay", lambda _: "")


class InThread:
    """A sender in this process: see `islandgp.tracking.sender.Sender`."""

    def __init__(self, tell: Tell) -> None:
        self._worker = Worker(tell)
        Thread(target=self._worker.work, name="sender", daemon=True).start()

    def add(self, order: Order) -> None:
        """Takes an order; returns at once."""
        self._worker.add(order)

    def close(self) -> None:
        """The order that is being carried out is the last one."""
        self._worker.end()


@pytest.fixture(autouse=True)
def _sender_in_this_process(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Loading MLflow takes seconds: the tests of this process do so once, and not in another."""
    monkeypatch.setattr(mlflow.MLflow, "sender", InThread)
    yield
    mlflow.close_client()


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts background jobs so; tests of Ctrl-C, and what they start, must take it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    # `nohup` starts its command so; the tests of a terminal that goes away send it.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
