"""What each kind of node does in a tick, as a closure that holds the node's memory.

These are the node kinds of section 2.2.3 with the meaning that `docs/semantics.md`
gives them, one function each. Guards and the composites that observe them are in
`observing`; `engine` puts them all together.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from islandgp.bt.node import AGAIN, FAILURE, RUNNING, SUCCESS

Tick: TypeAlias = Callable[[bool], int]  # (fresh) -> status
Stop: TypeAlias = Callable[[int, int], None]  # tells a watch: (first place, place behind the last)


def composite(branches: list[Tick], go_on: int) -> Tick:
    """A selector (`go_on` is FAILURE) or a sequence (SUCCESS) that observes nothing."""
    count = len(branches)
    current = 0

    def tick(fresh: bool) -> int:
        nonlocal current
        at = 0 if fresh else current
        status = branches[at](fresh)
        while status == go_on:
            at += 1
            if at == count:
                return status
            status = branches[at](True)
        current = at
        return status

    return tick


def parallel(
    branches: list[Tick], success: int, failure: int, places: list[int], stop: Stop
) -> Tick:
    """All children at once; `success` and `failure` are how many of them decide."""
    count = len(branches)
    statuses = [RUNNING] * count

    def tick(fresh: bool) -> int:
        succeeded = failed = 0
        going = RUNNING
        for at, branch in enumerate(branches):
            status = statuses[at]
            if fresh or status >= RUNNING:
                status = statuses[at] = branch(fresh)
            if status == SUCCESS:
                succeeded += 1
            elif status == FAILURE:
                failed += 1
            elif status == AGAIN:
                going = AGAIN
        if failed < failure and succeeded < success and succeeded + failed < count:
            return going
        for at, status in enumerate(statuses):
            if status >= RUNNING:
                stop(places[at], places[at + 1])
        return SUCCESS if failed < failure and succeeded >= success else FAILURE

    return tick


def inverter(child: Tick) -> Tick:
    """Swaps success and failure."""

    def tick(fresh: bool) -> int:
        status = child(fresh)
        return status if status >= RUNNING else SUCCESS - status

    return tick


def repeater(child: Tick, count: int) -> Tick:
    """One repetition a tick, until the child has succeeded `count` times."""
    left = 0  # successes still to come
    due = False  # the next tick starts a repetition

    def tick(fresh: bool) -> int:
        nonlocal left, due
        if fresh:
            left = count
        status = child(fresh or due)
        due = False
        if status == SUCCESS:
            left -= 1
            due = left > 0
        return AGAIN if due else status

    return tick
