"""The limit for the time of an episode."""

from __future__ import annotations

import signal
from time import sleep

import pytest

from islandgp.errors import TimeLimitError
from islandgp.time_limit import time_limit


def test_time_in_which_the_process_is_suspended_does_not_count() -> None:
    """A blocked signal is delivered once afterwards, like those of a suspended process."""
    with time_limit(0.3):
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

    with pytest.raises(TimeLimitError, match=r"within 0\.1 s"), time_limit(0.1):
        episode()


@pytest.mark.parametrize("seconds", [1e-9, 1e-6, 1e-4])
def test_a_limit_shorter_than_any_episode(seconds: float) -> None:
    """It is exceeded in the block, never outside of it, and its signals end with the block."""

    def episode() -> None:
        while True:
            pass

    before = signal.getsignal(signal.SIGALRM)
    for _ in range(20):
        with pytest.raises(TimeLimitError, match=f"within {seconds:g} s"), time_limit(seconds):
            episode()
        assert signal.getsignal(signal.SIGALRM) == before
    sleep(0.02)
