"""All sequences of ticks of a tree on the real engine, for trees and blackboards that are few.

The state of a compiled tree is in the closures of the engine. It is read there and put back, so
that each state is looked at once, however many sequences lead to it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise, product
from math import ceil, floor, inf
from types import CellType, FunctionType
from typing import Any, TypeAlias

from islandgp.bt.core.condition import ConditionExpr, condition, terms
from islandgp.bt.core.engine import Guard, compile_tree
from islandgp.bt.core.node import Node, guard_of, walk
from islandgp.bt.core.vocabulary import Key, Vocabulary

State: TypeAlias = tuple[tuple[Any, ...], tuple[tuple[Any, ...], ...], tuple[bool | None, ...]]
Ticked: TypeAlias = set[tuple[int, int]]  # (place of an action, index of a blackboard)


class Engine:
    """A compiled tree whose state can be read and restored; a script sets its results."""

    def __init__(self, tree: Node, vocabulary: Vocabulary) -> None:
        self.board = [0.0] * len(vocabulary.key_index)
        self.calls: list[int] = []  # places of the actions that were ticked in the last tick
        self.script: Callable[[int], int] = int
        places = (place for place, node in enumerate(walk(tree)) if node.action)
        engine = self

        class Leaves(dict[str, Callable[[bool], int]]):
            def __missing__(self, name: str) -> Callable[[bool], int]:
                place = next(places)

                def act(_: bool) -> int:
                    engine.calls.append(place)
                    return engine.script(place)

                return act

        self.tick = compile_tree(tree, Leaves(), self.board, vocabulary.key_index, step_s=1.0)
        self._cells: list[CellType] = []
        self._lists: list[list[Any]] = []
        self._guards: list[Guard] = []
        self._find(self.tick, set())

    def _find(self, value: Any, visited: set[int]) -> None:
        """Finds the cells, lists and guards below a closure in which its state is."""
        if id(value) in visited or value is self.board or value is self.calls:
            return
        visited.add(id(value))
        if isinstance(value, FunctionType):
            for cell in value.__closure__ or ():
                if not isinstance(cell.cell_contents, int | float):  # nor True or False
                    self._find(cell.cell_contents, visited)
                elif id(cell) not in visited:
                    visited.add(id(cell))
                    self._cells.append(cell)
        elif isinstance(value, Guard):
            self._guards.append(value)
        elif isinstance(value, list) and all(isinstance(v, int | float | None) for v in value):
            self._lists.append(value)
        elif isinstance(value, list | tuple):
            for each in value:
                self._find(each, visited)

    def state(self) -> State:
        """What the tree remembers."""
        cells = tuple(cell.cell_contents for cell in self._cells)
        return cells, tuple(map(tuple, self._lists)), tuple(guard.truth for guard in self._guards)

    def restore(self, state: State) -> None:
        """Puts a state back."""
        for cell, value in zip(self._cells, state[0], strict=True):
            cell.cell_contents = value
        for values, before in zip(self._lists, state[1], strict=True):
            values[:] = before
        for guard, truth in zip(self._guards, state[2], strict=True):
            guard.truth = truth


def every_tick(
    tree: Node, boards: Sequence[Sequence[float]], vocabulary: Vocabulary, max_ticks: int
) -> Ticked | None:
    """On which of the blackboards each action is ticked, in any sequence of ticks of any length.

    The actions return each of their statuses. None if that takes more than `max_ticks` ticks.
    """
    engine = Engine(tree, vocabulary)
    statuses = {
        place: sorted(vocabulary.action(node.action).statuses)
        for place, node in enumerate(walk(tree))
        if node.action
    }
    ticked: Ticked = set()
    first = engine.state()
    states, waiting, ticks = {first}, deque([first]), 0
    while waiting:
        state = waiting.popleft()
        for index, board in enumerate(boards):
            scripts: list[list[int]] = [[]]
            while scripts:
                ticks += 1
                if ticks > max_ticks:
                    return None
                scripts += _tick(engine, state, board, scripts.pop(), statuses)
                ticked |= {(place, index) for place in engine.calls}
                if (after := engine.state()) not in states:
                    states.add(after)
                    waiting.append(after)
    return ticked


def _tick(
    engine: Engine,
    state: State,
    board: Sequence[float],
    script: Sequence[int],
    statuses: Mapping[int, Sequence[int]],
) -> list[list[int]]:
    """One tick in which the actions return the script, and then their first statuses.

    Gives the scripts with other statuses behind that script.
    """
    returned: list[int] = []
    others: list[list[int]] = []

    def give(place: int) -> int:
        if len(returned) < len(script):
            status = script[len(returned)]
        else:
            status, *rest = statuses[place]
            others.extend([*returned, other] for other in rest)
        returned.append(status)
        return status

    engine.restore(state)
    engine.board[:] = board
    engine.calls.clear()
    engine.script = give
    engine.tick()
    return others


def all_boards(tree: Node, vocabulary: Vocabulary, *also: ConditionExpr) -> list[list[float]]:
    """Blackboards on which the guards of a tree, and these conditions, differ in all ways.

    There is one of each kind: for each key that is read, values at, between, below and above the
    numbers that it is compared with, as far as they are in its range.
    """
    expressions = [*(guard_of(node).condition for node in walk(tree) if node.guard), *also]
    numbers: dict[str, set[float]] = {}
    for term in (term for each in expressions for term in terms(each)):
        numbers.setdefault(term.key, set()).add(term.number)
    values = [
        _values(key, sorted(numbers[name])) if name in numbers else [key.low]
        for name, key in vocabulary.keys.items()
    ]
    board = [0.0] * len(values)
    holds = [condition(each, board, vocabulary.key_index) for each in expressions]
    by_truth: dict[tuple[bool, ...], list[float]] = {}
    for each in product(*values):
        board[:] = each
        by_truth.setdefault(tuple(hold() for hold in holds), list(each))
    return list(by_truth.values())


def _values(key: Key, numbers: Sequence[float]) -> list[float]:
    if key.flag:
        return [0.0, 1.0]
    between = [(a + b) / 2 for a, b in pairwise(numbers)]
    most = inf if key.most is None else key.most
    values = {numbers[0] - 1, *numbers, *between, numbers[-1] + 1, key.low}
    if key.whole:
        values = {float(whole) for value in values for whole in (floor(value), ceil(value))}
    return sorted(value for value in values if key.low <= value <= most)
