"""The tick functions of the control nodes of Nav2, as those of `closures`."""

from __future__ import annotations

from islandgp.bt.core.compiler import Compiler, Observed, Tick
from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS, Node


def pipeline(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """A sequence that begins with its first child in each tick.

    The next child starts after a success. It is also ticked while the child before it is running,
    if it or a later one has run since the pipeline started.
    """
    branches, positions = compiler.children(node)
    stop = compiler.stop_midtick
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
                stop(positions[at], positions[at + 1])
        return status

    return tick


def round_robin(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Tries its children in turn; begins after the child that succeeded last."""
    branches, _positions = compiler.children(node)
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


def recovery(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Runs the second child after a failure of the first, and then the first again."""
    (child, remedy), _positions = compiler.children(node)
    count, remaining = compiler.count(node), 0.0
    recovering = False

    def tick(fresh: bool) -> int:
        nonlocal remaining, recovering
        if fresh:
            remaining, recovering = count(), False
        while True:
            if recovering:
                status = remedy(fresh)
                if status != SUCCESS:
                    return status
                remaining -= 1
            else:
                status = child(fresh)
                if status != FAILURE or remaining < 1:
                    return status
            recovering, fresh = not recovering, True

    return tick


def every(compiler: Compiler, node: Node, observed: Observed | None) -> Tick:
    """Starts its child again some ticks after its success."""
    (child, _), ticks = compiler.child(node, observed), compiler.ticks(node)
    due = 0  # the first tick in which the child may start
    before = FAILURE  # its status in the tick before; RUNNING at a start: it was aborted
    started = False  # True: the child is running

    def tick(fresh: bool) -> int:
        nonlocal due, before, started
        if fresh:
            started = False
            due = due if before == SUCCESS else 0
        if not started and compiler.now < due:
            before = RUNNING
            return AGAIN
        before = child(not started)
        started = before >= RUNNING
        if before == SUCCESS:
            due = compiler.now + ticks()
        return before

    return tick
