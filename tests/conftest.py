"""What holds for the whole test suite: which tests run, and how Hypothesis searches."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import hypothesis
import pytest

from islandgp.tracking import mlflow
from islandgp.tracking.sender import InThread

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


@pytest.fixture(autouse=True)
def _sender_in_this_process(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Loading MLflow takes seconds: the tests of this process do so once, and not in another."""
    monkeypatch.setattr(mlflow.MLflow, "sender", InThread)
    yield
    mlflow.close_line()


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts background jobs so; tests of Ctrl-C, and what they start, must take it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    # `nohup` starts its command so; the tests of a terminal that goes away send it.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
