"""The tick functions of Nav2's control nodes: pipeline, round robin and recovery."""

from __future__ import annotations

from islandgp.bt.core.closures import ReportStopped, Tick
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS


def pipeline(branches: list[Tick], positions: list[int], report_stopped: ReportStopped) -> Tick:
    """A sequence that begins with its first child in each tick and passes running ones.

    A running child is passed if it is before the furthest child that ran in this activation.
    """
    running = [False] * len(branches)
    furthest = 0

    def tick(fresh: bool) -> int:
        nonlocal furthest
        if fresh:
            running[:] = [False] * len(branches)
            furthest = 0
        status = SUCCESS
        for at, branch in enumerate(branches):
            status = branch(not running[at])
            running[at] = status >= RUNNING
            if status == FAILURE:
                break
            if running[at] and at >= furthest:
                furthest = at
                # The children before it that ended start again in the next tick.
                return AGAIN if at else status
        for at, still_running in enumerate(running):
            if still_running:
                report_stopped(positions[at], positions[at + 1])
        return status

    return tick


def round_robin(branches: list[Tick]) -> Tick:
    """Tries its children in turn; begins after the child that succeeded last."""
    current = failed = 0
    running = False  # at a start: it was aborted

    def tick(fresh: bool) -> int:
        nonlocal current, failed, running
        if fresh:
            failed = 0
            current = 0 if running else current
        while True:
            status = branches[current](fresh)
            running = status >= RUNNING
            if running:
                return status
            current = (current + 1) % len(branches)
            failed += status == FAILURE
            if status == SUCCESS:
                return status
            if failed == len(branches):
                current = 0
                return status
            fresh = True

    return tick


def recovery(child: Tick, remedy: Tick, count: float) -> Tick:
    """Runs the remedy after a failure of the child and then the child again, `count` times."""
    left = count
    recovering = False

    def tick(fresh: bool) -> int:
        nonlocal left, recovering
        if fresh:
            left, recovering = count, False
        while True:
            if recovering:
                status = remedy(fresh)
                if status != SUCCESS:
                    return status
                left -= 1
            else:
                status = child(fresh)
                if status != FAILURE or left == 0:
                    return status
            recovering, fresh = not recovering, True

    return tick
