"""Composites that run one child at a time, and end with the status of the last one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from islandgp.bt.core.engine import Compiler, Observed, Tick
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node

END: Final = -1  # in place of the index of a child: no other child starts


def _steered(
    compiler: Compiler, node: Node, first: Callable[[], int], after: Callable[[int, int], int]
) -> Tick:
    """The tick function of a composite.

    Args:
        compiler: compiles the children.
        node: the composite.
        first: called at a start; returns the index of the child that starts.
        after: called with the index of a child that has ended and its status; returns the index of
            the child that starts in the same tick, or END.
    """
    branches = [tick for tick, _ in compiler.children(node)]
    current = 0

    def tick(fresh: bool) -> int:
        nonlocal current
        at = first() if fresh else current
        while (status := branches[at](fresh)) < RUNNING:
            if (following := after(at, status)) == END:
                return status
            at, fresh = following, True
        current = at
        return status

    return tick


def random_selector(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Tries its children in an order that it draws at each start until one succeeds."""
    order = compiler.order(len(node.children))
    waiting: list[int] = []

    def first() -> int:
        waiting[:] = order()
        return waiting.pop(0)

    def after(_: int, status: int) -> int:
        return waiting.pop(0) if status == FAILURE and waiting else END

    return _steered(compiler, node, first, after)


def if_else(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Runs its first child, then the second after a success, and after a failure the third."""
    third = 2 if len(node.children) > 2 else END

    def after(child: int, status: int) -> int:
        return END if child else 1 if status == SUCCESS else third

    return _steered(compiler, node, lambda: 0, after)


def round_robin(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Tries its children in turn; begins after the child that succeeded last."""
    count = len(node.children)
    start = begun = 0  # the child with which it begins next, and with which it began

    def first() -> int:
        nonlocal start, begun
        begun, start = start, 0  # after an abort it begins with the first child
        return begun

    def after(child: int, status: int) -> int:
        nonlocal start
        following = (child + 1) % count
        if status == SUCCESS:
            start = following
        return END if status == SUCCESS or following == begun else following

    return _steered(compiler, node, first, after)


def recovery(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
    """Runs the second child after a failure of the first, and then the first again."""
    count, remaining = compiler.count(node), 0.0

    def first() -> int:
        nonlocal remaining
        remaining = count()
        return 0

    def after(child: int, status: int) -> int:
        nonlocal remaining
        if child == 0:
            return 1 if status == FAILURE and remaining >= 1 else END
        remaining -= 1
        return 0 if status == SUCCESS else END

    return _steered(compiler, node, first, after)
