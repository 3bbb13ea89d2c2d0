"""The thread that sends records: how long the end of a command waits for it."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event
from time import monotonic

import pytest

from islandgp.tracking import mlflow as sender_module
from islandgp.tracking.mlflow import Sender

COMMAND = "islandgp sync runs/a"


@pytest.fixture
def sender(monkeypatch: pytest.MonkeyPatch) -> Sender:
    """A sender that has loaded MLflow; it repeats a failed task at once."""
    monkeypatch.setattr(sender_module, "load", lambda: "")
    monkeypatch.setattr(sender_module, "RETRY_DELAY", 0.01)
    monkeypatch.setattr(sender_module, "MESSAGE_DELAY", 0.1)
    return Sender()


def task(*results: str | Exception) -> Callable[[], str]:
    """A task with these results, one after the other; the last one is repeated."""
    rest = list(results)

    def send() -> str:
        result = rest.pop(0) if len(rest) > 1 else rest[0]
        if isinstance(result, Exception):
            raise result
        return result

    return send


@pytest.mark.parametrize(
    ("results", "reason"),
    [
        pytest.param([""], "", id="sent"),
        pytest.param(["runs/a: damaged"], "runs/a: damaged", id="partly-sent"),
        pytest.param([OSError("refused"), OSError("refused"), ""], "", id="back-again"),
        pytest.param([OSError("refused")], "refused", id="away"),
    ],
)
def test_a_task_is_repeated_until_it_succeeds(
    results: list[str | Exception], reason: str, sender: Sender
) -> None:
    """Or until the patience is over; the last error is the reason."""
    began = monotonic()
    assert sender.finish(task(*results), 0.5, COMMAND, may_hang=False) == reason
    assert (monotonic() - began >= 0.5) == (reason == "refused")


def test_a_silent_server_is_given_up(sender: Sender, capsys: pytest.CaptureFixture[str]) -> None:
    """After the patience, which begins again with each answer; one line says how to leave."""
    silence = Event()

    def send() -> str:
        for _ in range(3):
            silence.wait(0.3)
            sender.alive()
        silence.wait()
        return ""

    began = monotonic()
    assert sender.finish(send, 0.5, COMMAND, may_hang=True) == "no answer in 0.5 s"
    assert monotonic() - began > 1.3
    assert capsys.readouterr().err == (
        f"sending to MLflow; Ctrl-C stops waiting, `{COMMAND}` sends the rest\n"
    )
    silence.set()


def test_a_slow_file_is_waited_for(sender: Sender) -> None:
    """A new store takes minutes on a slow disk."""
    begun = Event()

    def send() -> str:
        begun.wait(0.5)
        return ""

    assert sender.finish(send, 0.1, COMMAND, may_hang=False) == ""


def test_without_patience_the_run_does_not_wait(
    sender: Sender, capsys: pytest.CaptureFixture[str]
) -> None:
    """A sweep sends what is missing at its end. The thread goes on meanwhile."""
    go_on, sent = Event(), Event()

    def send() -> str:
        go_on.wait()
        sent.set()
        return ""

    assert sender.finish(send, 0, COMMAND, may_hang=False) == "no answer in 0 s"
    go_on.set()
    assert sent.wait(10)
    assert capsys.readouterr().err == ""


def test_ctrl_c_ends_the_waiting(sender: Sender, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run is over: it is no error, and the records can be sent later."""

    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sender_module, "wait", pressed)
    assert sender.finish(task(""), 20, COMMAND, may_hang=False) == "waiting was interrupted"


def test_mlflow_that_cannot_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is the reason why nothing was sent; the run's thread goes on."""

    def load() -> str:
        raise ImportError("no module named mlflow")

    monkeypatch.setattr(sender_module, "load", load)
    begun = Sender()
    assert begun.finish(load, 0.3, COMMAND, may_hang=False) == "no module named mlflow"
    assert begun.finish(task(""), 20, COMMAND, may_hang=False) == ""
