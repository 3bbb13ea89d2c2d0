"""What a `when` asks: conditions on blackboard keys, alone or joined by `and`, `or`, `not`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Final, NamedTuple, TypeAlias

OPERATORS: Final = ("<", "<=", ">", ">=", "==", "!=")
FLAG_OPERATORS: Final = ("is", "not")  # `when FLAG` and `when not FLAG`; their number is 0

Board: TypeAlias = Sequence[float]
"""A value per key, in the order of the vocabulary; flags are 0 or 1."""


class Condition(NamedTuple):
    """One comparison, or one flag."""

    key: str
    operator: str  # of OPERATORS or FLAG_OPERATORS
    number: float  # 0 for a flag


class Compound(NamedTuple):
    """Conditions that are joined, or denied; made by `joined` and `denied`.

    Equal meanings may be written differently, but each way of writing is one value: `and` holds
    no `and`, `or` no `or`, and `not` neither a flag nor another `not`.
    """

    word: str  # and, or: of two parts or more; not: of one
    parts: tuple[Condition | Compound, ...]


Asked: TypeAlias = Condition | Compound

OPPOSITE: Final = {
    "<": ">=",
    ">=": "<",
    ">": "<=",
    "<=": ">",
    "==": "!=",
    "!=": "==",
    "is": "not",
    "not": "is",
}
"""The operator that holds where another one does not."""


def joined(word: str, parts: Sequence[Asked]) -> Asked:
    """The parts joined by `and` or `or`; one part is itself."""
    flat: list[Asked] = []
    for part in parts:
        same = isinstance(part, Compound) and part.word == word
        flat += part.parts if isinstance(part, Compound) and same else (part,)
    return flat[0] if len(flat) == 1 else Compound(word, tuple(flat))


def denied(asked: Asked) -> Asked:
    """`not` of a condition; of a flag and of another `not`, without that word."""
    if isinstance(asked, Compound):
        return asked.parts[0] if asked.word == "not" else Compound("not", (asked,))
    if asked.operator in FLAG_OPERATORS:
        return asked._replace(operator=OPPOSITE[asked.operator])
    return Compound("not", (asked,))


def opposite(asked: Asked) -> Asked:
    """What holds where a condition does not, said without the word `not` before a compound."""
    if isinstance(asked, Condition):
        return asked._replace(operator=OPPOSITE[asked.operator])
    if asked.word == "not":
        return spread(asked.parts[0])
    return joined({"and": "or", "or": "and"}[asked.word], [opposite(p) for p in asked.parts])


def spread(asked: Asked) -> Asked:
    """The same condition with each `not` turned into the opposite of what it denies."""
    if isinstance(asked, Condition):
        return asked
    if asked.word == "not":
        return opposite(asked.parts[0])
    return joined(asked.word, [spread(part) for part in asked.parts])


def terms(asked: Asked) -> Iterator[Condition]:
    """The single conditions, in order."""
    if isinstance(asked, Condition):
        yield asked
    else:
        for part in asked.parts:
            yield from terms(part)


def with_term(asked: Asked, index: int, new: Asked | None) -> Asked | None:
    """The condition with its single condition of that index, from 0, replaced; None: without it."""
    if isinstance(asked, Condition):
        return new if index == 0 else asked
    parts: list[Asked] = []
    for part in asked.parts:
        count = sum(1 for _ in terms(part))
        changed = with_term(part, index, new) if 0 <= index < count else part
        parts += [] if changed is None else [changed]
        index -= count
    if not parts:
        return None
    return denied(parts[0]) if asked.word == "not" else joined(asked.word, parts)


def condition(asked: Asked, board: Board, places: Mapping[str, int]) -> Callable[[], bool]:
    """Whether the condition holds on the board at the moment of the call.

    `places` is the index of each key on the board.
    """
    if isinstance(asked, Compound):
        return _compiled(_expression(asked, places))(board)
    place, operator, number = places[asked.key], asked.operator, asked.number
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


def _expression(asked: Asked, places: Mapping[str, int]) -> str:
    """The condition as Python text; it holds nothing of the tree but numbers."""
    if isinstance(asked, Compound):
        parts = [_expression(part, places) for part in asked.parts]
        return f"(not {parts[0]})" if asked.word == "not" else f"({f' {asked.word} '.join(parts)})"
    operator = {"is": "!=", "not": "=="}.get(asked.operator, asked.operator)
    if operator not in OPERATORS:
        raise ValueError(f"Expected one of {', '.join(OPERATORS)}, is, not; found {operator!r}.")
    return f"(board[{places[asked.key]:d}] {operator} {float(asked.number)!r})"


@lru_cache(maxsize=1024)
def _compiled(expression: str) -> Callable[[Board], Callable[[], bool]]:
    # One closure whatever is joined: a call for each part would cost a tick two to five times more.
    made: Callable[[Board], Callable[[], bool]] = eval(
        f"lambda board: lambda: {expression}", {"__builtins__": {}}
    )
    return made
