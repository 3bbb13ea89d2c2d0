"""The conditions of `when` nodes, as functions of a blackboard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

from islandgp.bt.node import KEYS, OPERATORS, Node, walk

Board: TypeAlias = Sequence[float]  # a value per key of KEYS, in that order; flags are 0 or 1

_PLACES: Final = {key: place for place, key in enumerate(KEYS)}


def condition(node: Node, board: Board) -> Callable[[], bool]:
    """Whether the condition of a `when` holds on the board at the moment of the call."""
    place, operator, number = _PLACES[str(node.args[0])], node.args[1], float(node.args[2])
    if operator == "<":
        return lambda: board[place] < number
    if operator == "<=":
        return lambda: board[place] <= number
    if operator == ">":
        return lambda: board[place] > number
    if operator == ">=":
        return lambda: board[place] >= number
    if operator == "==":
        return lambda: board[place] == number
    if operator == "!=":
        return lambda: board[place] != number
    if operator == "is":
        return lambda: board[place] != 0
    if operator == "not":
        return lambda: board[place] == 0
    raise ValueError(f"Expected one of {', '.join(OPERATORS)}, is, not; found {operator!r}.")


def thresholds(tree: Node, key: str = "batteryLevel") -> tuple[float, ...]:
    """The numbers that a tree compares a key with, ascending, each once.

    As long as the key's value stays between two neighbours, and on neither of
    them, no condition on it changes its truth.
    """
    asked = (node.args for node in walk(tree) if node.kind == "when")
    return tuple(sorted({float(args[2]) for args in asked if args[0] == key}))
