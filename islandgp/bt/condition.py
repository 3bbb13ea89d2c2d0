"""The conditions of `when` nodes, as functions of a blackboard."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from islandgp.bt.node import OPERATORS, Node, walk

Board: TypeAlias = Sequence[float]
"""A value per key, in the order of the vocabulary; flags are 0 or 1."""


def condition(node: Node, board: Board, places: Mapping[str, int]) -> Callable[[], bool]:
    """Whether the condition of a `when` holds on the board at the moment of the call.

    `places` is the index of each key on the board.
    """
    place, operator, number = places[str(node.args[0])], node.args[1], float(node.args[2])
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


def thresholds(tree: Node, key: str) -> tuple[float, ...]:
    """The numbers that a tree compares a key with, ascending, each once.

    As long as the key's value stays between two neighbours, and on neither of
    them, no condition on it changes its truth.
    """
    asked = (node.args for node in walk(tree) if node.kind == "when")
    return tuple(sorted({float(args[2]) for args in asked if args[0] == key}))
