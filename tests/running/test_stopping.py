"""Signals that end a command as Ctrl-C does."""

from __future__ import annotations

import signal
import sys
import time

import pytest

from islandgp.running.stopping import as_ctrl_c


class Finalized:
    """Its end takes a while, in which a signal comes."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)


def work() -> None:
    """A signal comes in a finalizer; then it goes on for ten seconds, unless something ends it."""
    Finalized()
    until = time.monotonic() + 10
    while time.monotonic() < until:
        time.sleep(0.01)


def test_a_signal_that_a_finalizer_swallows_comes_again() -> None:
    """Python lets no exception out of a finalizer, and a simulator frees its spaces in one."""
    ours = sys.unraisablehook
    with pytest.raises(KeyboardInterrupt), as_ctrl_c("SIGTERM"):
        work()
    assert sys.unraisablehook is ours


def test_other_faults_of_finalizers_are_told_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """They end nothing."""
    told: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda found: told.append(found.exc_value))

    class Faulty:
        def __del__(self) -> None:
            raise ValueError("no")

    with as_ctrl_c("SIGTERM"):
        Faulty()
    assert [str(fault) for fault in told] == ["no"]
