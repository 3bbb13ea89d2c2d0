"""What holds for the whole test suite: which tests run, and how Hypothesis searches."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from threading import Thread

import hypothesis
import pytest

from islandgp.tracking import mlflow
from islandgp.tracking.sender import Order, Tell, Worker

# Every run tries the same examples, so that a red test stays red until it is mended.
# `pytest --hypothesis-profile=search` looks for new ones.
hypothesis.settings.register_profile("fixed", deadline=None, derandomize=True, database=None)
hypothesis.settings.register_profile("search", deadline=None, max_examples=1000)
hypothesis.settings.load_profile("fixed")


def pytest_configure(config: pytest.Config) -> None:
    """Tests marked `slow` run only when `-m` asks for them: `pytest -m slow`."""
    config.addinivalue_line("markers", "slow: exhaustive, takes longer than a second")
    if not config.option.markexpr:
        config.option.markexpr = "not slow"


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
