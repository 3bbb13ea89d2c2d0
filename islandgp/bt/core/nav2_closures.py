"""The tick functions of the control nodes of Nav2: pipeline, round robin and recovery."""

from __future__ import annotations

from islandgp.bt.core.closures import ReportStopped, Tick
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS


def pipeline(branches: list[Tick], positions: list[int], report_stopped: ReportStopped) -> Tick:
    """A sequence that begins with its first child in each tick.

    The next child starts after a success. It is also ticked while the child before it is running,
    if it or a later one has run since the pipeline started.
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
    running = False  # True at a start: the node was aborted

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
    remaining = count
    recovering = False

    def tick(fresh: bool) -> int:
        nonlocal remaining, recovering
        if fresh:
            remaining, recovering = count, False
        while True:
            if recovering:
                status = remedy(fresh)
                if status != SUCCESS:
                    return status
                remaining -= 1
            else:
                status = child(fresh)
                if status != FAILURE or remaining == 0:
                    return status
            recovering, fresh = not recovering, True

    return tick
