"""The limit for the time of an episode."""

from __future__ import annotations

import signal
from concurrent.futures import Future
from time import sleep
from typing import Any

import pytest

from islandgp.errors import TimeLimitError
from islandgp.evaluation import processes
from islandgp.time_limit import TimeLimit


def test_time_in_which_the_process_is_suspended_does_not_count() -> None:
    """A blocked signal is delivered once afterwards, like those of a suspended process."""
    with TimeLimit(0.3):
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])
        sleep(0.4)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGALRM])


@pytest.mark.parametrize("busy", [True, False])
def test_time_at_work_and_time_of_waiting_count(busy: bool) -> None:
    """A loop that does not end, and a call that does not return."""

    def episode() -> None:
        while busy:
            pass
        sleep(60)

    with pytest.raises(TimeLimitError, match=r"within 0\.1 s"), TimeLimit(0.1):
        episode()


def test_waiting_for_a_worker_goes_on_after_a_suspension(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the first of ten waits takes a suspended process beyond its time."""
    future: Future[Any] = Future()
    waits = []

    def waited(futures: list[Future[Any]], seconds: float) -> Any:
        waits.append(seconds)
        if len(waits) == 2:
            future.set_result("an outcome")
        return real(futures, 0)

    real = processes.wait_for
    monkeypatch.setattr(processes, "wait_for", waited)
    assert processes._ends(future, 600)
    assert waits == [60, 60]
