"""The tick function of each kind of node: a closure that holds the node's memory.

`engine` compiles a tree with these functions and those of `nav2_closures`, one for each node kind,
as `docs/semantics.md` specifies them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from islandgp.bt.core.node import AGAIN, FAILURE, RUNNING, SUCCESS

Tick: TypeAlias = Callable[[bool], int]  # (fresh) -> status
ReportStopped: TypeAlias = Callable[[int, int], None]
"""Called when a subtree is stopped, with the position of its first node and that after its last.

Positions are in document order. It calls the watch but not the nodes: the next call of an aborted
action has `fresh=True`.
"""


def composite(branches: list[Tick], advance_status: int) -> Tick:
    """A selector (`advance_status` FAILURE) or a sequence (SUCCESS) without observed guards."""
    count = len(branches)
    current = 0

    def tick(fresh: bool) -> int:
        nonlocal current
        at = 0 if fresh else current
        status = branches[at](fresh)
        while status == advance_status:
            at += 1
            if at == count:
                return status
            status = branches[at](True)
        current = at
        return status

    return tick


def reactive_composite(
    branches: list[Tick], advance_status: int, positions: list[int], report_stopped: ReportStopped
) -> Tick:
    """A selector or sequence that begins with its first child in each tick."""
    current = 0  # the child that ran in the tick before

    def tick(fresh: bool) -> int:
        nonlocal current
        running = -1 if fresh else current
        for at, branch in enumerate(branches):
            status = branch(at != running)
            if status != advance_status:
                if running > at:
                    report_stopped(positions[running], positions[running + 1])
                current = at
                # The children before it start again in the next tick.
                return AGAIN if status == RUNNING and at else status
        return advance_status

    return tick


def parallel(
    branches: list[Tick],
    success: int,
    failure: int,
    positions: list[int],
    report_stopped: ReportStopped,
) -> Tick:
    """Ticks all children; succeeds after `success` successes, fails after `failure` failures."""
    count = len(branches)
    statuses = [RUNNING] * count

    def tick(fresh: bool) -> int:
        succeeded = failed = 0
        running = RUNNING
        for at, branch in enumerate(branches):
            status = statuses[at]
            if fresh or status >= RUNNING:
                status = statuses[at] = branch(fresh)
            if status == SUCCESS:
                succeeded += 1
            elif status == FAILURE:
                failed += 1
            elif status == AGAIN:
                running = AGAIN
        if failed < failure and succeeded < success and succeeded + failed < count:
            return running
        for at, status in enumerate(statuses):
            if status >= RUNNING:
                report_stopped(positions[at], positions[at + 1])
        return SUCCESS if failed < failure and succeeded >= success else FAILURE

    return tick


def inverter(child: Tick) -> Tick:
    """Swaps success and failure."""

    def tick(fresh: bool) -> int:
        status = child(fresh)
        return status if status >= RUNNING else SUCCESS - status

    return tick


def forced(child: Tick, end: int) -> Tick:
    """Ends with one status however the child ends."""

    def tick(fresh: bool) -> int:
        status = child(fresh)
        return status if status >= RUNNING else end

    return tick


def repeater(child: Tick, count: float, counted: int) -> Tick:
    """Repeats its child, once a tick, until it has ended `count` times with status `counted`."""
    remaining = 0.0  # ends with this status until the repeater ends
    due = False  # True: the next tick starts a repetition

    def tick(fresh: bool) -> int:
        nonlocal remaining, due
        if fresh:
            remaining = count
        status = child(fresh or due)
        due = False
        if status == counted:
            remaining -= 1
            due = remaining > 0
        return AGAIN if due else status

    return tick


def wait(child: Tick, ticks: int) -> Tick:
    """Starts its child `ticks` ticks after its own start."""
    remaining = 0

    def tick(fresh: bool) -> int:
        nonlocal remaining
        remaining = ticks if fresh else remaining - 1
        return AGAIN if remaining > 0 else child(remaining == 0)

    return tick


def timeout(child: Tick, ticks: int, span: tuple[int, int], report_stopped: ReportStopped) -> Tick:
    """Fails `ticks` ticks after its start if its child still runs; `span` as in `guard`."""
    remaining = 0

    def tick(fresh: bool) -> int:
        nonlocal remaining
        remaining = ticks if fresh else remaining - 1
        if remaining == 0:
            report_stopped(*span)
            return FAILURE
        status = child(fresh)
        return AGAIN if status == RUNNING else status

    return tick


def cooldown(child: Tick, ticks: int, now: Callable[[], int]) -> Tick:
    """Fails for `ticks` ticks after its child has ended; `now` returns the number of the tick."""
    ready = 0  # the first tick in which the child may start

    def tick(fresh: bool) -> int:
        nonlocal ready
        if fresh and now() < ready:
            return FAILURE
        status = child(fresh)
        if status < RUNNING:
            ready = now() + ticks
        return status

    return tick


def every(child: Tick, ticks: int, now: Callable[[], int]) -> Tick:
    """Starts its child again at least `ticks` ticks after its success; `now` as in `cooldown`."""
    due = 0  # the first tick in which the child may start
    before = FAILURE  # its status in the tick before; RUNNING at a start: it was aborted
    started = False  # True: the child is running

    def tick(fresh: bool) -> int:
        nonlocal due, before, started
        if fresh:
            started = False
            due = due if before == SUCCESS else 0
        if not started and now() < due:
            before = RUNNING
            return AGAIN
        before = child(not started)
        started = before >= RUNNING
        if before == SUCCESS:
            due = now() + ticks
        return before

    return tick


class ObservedGuard(NamedTuple):
    """A `when` that a composite observes while a later branch runs."""

    branch: int
    slot: int  # of `Observed.truth`
    holds: Callable[[], bool]


class Observed:
    """Observed guards of a composite."""

    __slots__ = ("branch", "guards", "truth")

    def __init__(self) -> None:
        self.branch = 0  # index of the branch that is being compiled
        self.guards: list[ObservedGuard] = []  # in document order
        self.truth: list[bool | None] = []  # last known, by slot; None: not visited yet

    def add(self, holds: Callable[[], bool]) -> int:
        """Add a guard of the branch that is being compiled; return its index in `truth`."""
        slot = len(self.guards)
        self.guards.append(ObservedGuard(self.branch, slot, holds))
        self.truth.append(None)
        return slot


def observing_composite(
    branches: list[Tick],
    advance_status: int,
    observed: Observed,
    positions: list[int],
    report_stopped: ReportStopped,
) -> Tick:
    """A selector or sequence that goes back to an earlier branch when its guard becomes true.

    Args:
        branches: the children.
        advance_status: the status of a branch after which the next one starts.
        observed: the guards of all branches but the last.
        positions: of the first node of each branch, and that after the last branch.
        report_stopped: called with the positions of the branch that is stopped.
    """
    count = len(branches)
    guards, truth = tuple(observed.guards), observed.truth
    unvisited: list[bool | None] = [None] * len(guards)
    current = 0

    def turned_true() -> int:
        """The branch of the first observed guard that became true, else the running branch."""
        for branch, slot, holds in guards:
            if branch >= current:
                break
            before = truth[slot]
            if before is not None:
                true_now = truth[slot] = holds()
                if true_now and not before:
                    return branch
        return current

    def tick(fresh: bool) -> int:
        nonlocal current
        if fresh:
            at = 0
            truth[:] = unvisited
        else:
            at = turned_true()
            if at != current:
                report_stopped(positions[current], positions[current + 1])
                fresh = True
                for branch, slot, _ in guards:
                    if branch >= at:
                        truth[slot] = None
        status = branches[at](fresh)
        if status == advance_status and not fresh:
            # The guards of this branch are observed from this tick on. Their stored values are
            # from the branch's start, which may be many ticks ago.
            for branch, slot, holds in guards:
                if branch == at and truth[slot] is not None:
                    truth[slot] = holds()
        while status == advance_status:
            at += 1
            if at == count:
                return status
            status = branches[at](True)
        current = at
        return status

    return tick


def guard(
    child: Tick,
    holds: Callable[[], bool],
    checks_itself: bool,
    truth: list[bool | None],
    slot: int,
    span: tuple[int, int],
    report_stopped: ReportStopped,
) -> Tick:
    """A `when`.

    Args:
        child: the guarded node.
        holds: the condition.
        checks_itself: True with `abort self` or `both`: the child is stopped when the condition
            becomes false.
        truth: the last known values of the conditions that its composite observes.
        slot: index of this condition in `truth`.
        span: position of the first node of the child, and that after its last.
        report_stopped: called with the positions of the child that is stopped.
    """

    def tick(fresh: bool) -> int:
        if fresh:
            truth[slot] = true_now = holds()
            return child(True) if true_now else FAILURE
        if checks_itself and not holds():
            report_stopped(*span)
            return FAILURE
        return child(False)

    return tick
