"""Composites that run one child at a time: a generator says which child comes next."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeAlias

from islandgp.bt.core.engine import Compiler, Maker, Observed, Tick
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node

Steps: TypeAlias = Callable[[], Generator[int, int, None]]
"""Yields the index of the child that starts, and is sent the status with which it ends."""


def steered(steps_of: Callable[[Compiler, Node], Steps]) -> Maker:
    """A composite that runs one child at a time and ends with the status of the last one.

    `steps_of`: of a node, called before its children are compiled, the steps from each start.
    """

    def make(compiler: Compiler, node: Node, _: Observed | None) -> Tick:
        start = steps_of(compiler, node)
        branches, _positions = compiler.children(node)
        steps, current = start(), 0

        def tick(fresh: bool) -> int:
            nonlocal steps, current
            if fresh:
                steps = start()
                current = next(steps)
            while (status := branches[current](fresh)) < RUNNING:
                try:
                    current = steps.send(status)
                except StopIteration:
                    break
                fresh = True
            return status

        return tick

    return make


def random_order(compiler: Compiler, node: Node) -> Steps:
    """Tries the children in an order that is drawn at each start until one succeeds."""
    order = compiler.order(len(node.children))

    def steps() -> Generator[int, int, None]:
        for child in order():
            if (yield child) == SUCCESS:
                return

    return steps


def choice(_: Compiler, node: Node) -> Steps:
    """Runs the first child, then the second after a success, and after a failure the third."""

    def steps() -> Generator[int, int, None]:
        if (yield 0) == SUCCESS:
            yield 1
        elif len(node.children) > 2:
            yield 2

    return steps


def turns(_: Compiler, node: Node) -> Steps:
    """Tries the children in turn; begins after the child that succeeded last."""
    count = len(node.children)
    first = 0

    def steps() -> Generator[int, int, None]:
        nonlocal first
        order = [*range(first, count), *range(first)]
        first = 0  # unless a child succeeds before an abort
        for child in order:
            if (yield child) == SUCCESS:
                first = (child + 1) % count
                return

    return steps


def recovering(compiler: Compiler, node: Node) -> Steps:
    """Runs the second child after a failure of the first, and then the first again."""
    count = compiler.count(node)

    def steps() -> Generator[int, int, None]:
        remaining = count()
        while (yield 0) == FAILURE and remaining >= 1:
            if (yield 1) == FAILURE:
                return
            remaining -= 1

    return steps
