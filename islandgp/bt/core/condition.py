"""Conditions on blackboard keys, alone or joined by `and`, `or`, `not`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import count
from math import ceil, floor
from typing import Any, Final, NamedTuple, TypeAlias

from islandgp.bt.core.arithmetic import (
    Formula,
    Term,
    divide,
    numbers_in,
    python,
    side,
    with_numbers,
)

OPERATORS: Final = ("<", "<=", ">", ">=", "==", "!=")
FLAG_OPERATORS: Final = ("is", "not")  # `when FLAG` and `when not FLAG`; their number is 0

Board: TypeAlias = Sequence[float]
"""A value per key, in the order of the vocabulary; flags are 0 or 1."""


class Condition(NamedTuple):
    """One comparison, or one flag."""

    key: str  # or a Formula of keys
    operator: str  # of OPERATORS or FLAG_OPERATORS
    number: float  # 0 for a flag and where two keys are compared; of a word, its index
    other: str = ""  # the key or Formula on the right; "": the key is compared with the number

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that it reads, each once."""
        if self.single:
            return (self.key,)
        sides = (s.keys if isinstance(s, Formula) else (s,) for s in (self.key, self.other) if s)
        return tuple(dict.fromkeys(key for names in sides for key in names))

    @property
    def single(self) -> bool:
        """True for a flag, and for one key that is compared with a number or a word."""
        return not self.other and not isinstance(self.key, Formula)

    @property
    def divides(self) -> bool:
        """True if it divides by a key; then its negation is no comparison."""
        return any(isinstance(s, Formula) and s.divides for s in (self.key, self.other))


class Compound(NamedTuple):
    """Conditions joined by `and` or `or`, or negated by `not`.

    `combine` and `negate` create it in a canonical form: no `and` is a part of an `and`, no `or`
    of an `or`, and `not` negates neither a flag nor another `not`.
    """

    word: str  # and, or: of two parts or more; not: of one
    parts: tuple[Condition | Compound, ...]


ConditionExpr: TypeAlias = Condition | Compound

WHOLE: Final = "whole"  # operator of a premise of analyses: the value of the key is a whole number

_NEGATIONS: Final = (("<", ">="), (">", "<="), ("==", "!="), ("is", "not"))
OPPOSITE: Final = {one: other for pair in _NEGATIONS for one, other in (pair, pair[::-1])}
"""The negation of each operator."""


MIRRORED: Final = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
"""The operator of the same comparison with its two sides exchanged."""


def comparison(left: Term, operator: str, right: Term) -> Condition:
    """A comparison of two terms; a number is on the right."""
    if not isinstance(right, str | tuple):
        return Condition(side(left), operator, right)
    if not isinstance(left, str | tuple):
        return Condition(side(right), MIRRORED[operator], left)
    return Condition(side(left), operator, 0.0, side(right))


def numbers_of(term: Condition) -> list[float]:
    """The numbers of a comparison, in order; of a flag, a word or two keys 0."""
    sides = [side.term for side in (term.key, term.other) if isinstance(side, Formula)]
    return [n for side in sides for n in numbers_in(side)] + [term.number] * (not term.other)


def with_number(term: Condition, index: int, number: float) -> Condition:
    """The comparison with number `index` of `numbers_of` replaced."""
    numbers = numbers_of(term)
    numbers[index] = number
    left = iter(numbers)
    key, other = (
        Formula(with_numbers(side.term, left)) if isinstance(side, Formula) else side
        for side in (term.key, term.other)
    )
    return Condition(key, term.operator, next(left, 0.0), other)


def ordered(expr: Condition) -> Condition:
    """The comparison in normal form: of two keys, the alphabetically first is on the left."""
    if not expr.other or expr.key <= expr.other:
        return expr
    return Condition(expr.other, MIRRORED[expr.operator], 0.0, expr.key)


def combine(word: str, parts: Sequence[ConditionExpr]) -> ConditionExpr:
    """Combine conditions by the word `and` or `or`; a single part is returned as it is."""
    flat: list[ConditionExpr] = []
    for part in parts:
        same = isinstance(part, Compound) and part.word == word
        flat += part.parts if isinstance(part, Compound) and same else (part,)
    return flat[0] if len(flat) == 1 else Compound(word, tuple(flat))


def rounded(term: Condition) -> Condition:
    """The same comparison of a whole number, without decimals if there is one."""
    if term.number % 1 == 0 or term.operator not in _ROUNDING:
        return term
    return term._replace(number=float(_ROUNDING[term.operator](term.number)))


_ROUNDING: Final = {"<": ceil, ">=": ceil, "<=": floor, ">": floor}


def negate(expr: ConditionExpr) -> ConditionExpr:
    """Negate a condition; a flag and a double `not` lose the word."""
    if isinstance(expr, Compound):
        return expr.parts[0] if expr.word == "not" else Compound("not", (expr,))
    if expr.operator in FLAG_OPERATORS:
        return expr._replace(operator=OPPOSITE[expr.operator])
    return Compound("not", (expr,))


def opposite(expr: ConditionExpr) -> ConditionExpr:
    """The negation of a condition, in negation normal form."""
    return to_nnf(expr, negated=True)


def to_nnf(expr: ConditionExpr, *, negated: bool = False) -> ConditionExpr:
    """A condition or its negation in negation normal form: `not` only negates a division."""
    if isinstance(expr, Condition):
        if negated and expr.divides:
            return Compound("not", (expr,))
        return expr._replace(operator=OPPOSITE[expr.operator]) if negated else expr
    if expr.word == "not":
        return to_nnf(expr.parts[0], negated=not negated)
    word = {"and": "or", "or": "and"}[expr.word] if negated else expr.word
    return combine(word, [to_nnf(part, negated=negated) for part in expr.parts])


def terms(expr: ConditionExpr) -> Iterator[Condition]:
    """The single conditions, in order."""
    if isinstance(expr, Condition):
        yield expr
    else:
        for part in expr.parts:
            yield from terms(part)


def with_terms(
    expr: ConditionExpr, change: Callable[[Condition], ConditionExpr | None]
) -> ConditionExpr | None:
    """Replace each single condition by what `change` makes of it; None if nothing is left.

    `change` returns None to remove a condition. It is called in the order of the conditions.
    """
    if isinstance(expr, Condition):
        return change(expr)
    parts = [part for each in expr.parts if (part := with_terms(each, change)) is not None]
    if not parts:
        return None
    return negate(parts[0]) if expr.word == "not" else combine(expr.word, parts)


def with_term(expr: ConditionExpr, index: int, new: ConditionExpr | None) -> ConditionExpr | None:
    """Replace single condition number `index`, from 0, or remove it; None if nothing is left."""
    places = count()
    return with_terms(expr, lambda term: new if next(places) == index else term)


def condition(
    expr: ConditionExpr, board: Board, key_index: Mapping[str, int]
) -> Callable[[], bool]:
    """True if the condition holds on the board at the moment of the call.

    `key_index` is the index of each key on the board.
    """
    return _compiled(source(expr, _on_board(key_index), _literal))(board)


def assigned_value(
    assigned: Condition, board: Board, key_index: Mapping[str, int]
) -> Callable[[], float]:
    """The value that a key gets: the right side of an assignment."""
    right, of_key = assigned.other, _on_board(key_index)
    return _compiled(side_source(right, of_key) if right else _literal(assigned.number))(board)


def _on_board(key_index: Mapping[str, int]) -> Callable[[str], str]:
    return lambda key: f"board[{key_index[key]:d}]"


def _literal(number: float) -> str:
    return repr(float(number))


def source(
    expr: ConditionExpr, of_key: Callable[[str], str], of_number: Callable[[float], str]
) -> str:
    """The condition as Python source, with those of the values of keys and of numbers."""
    if isinstance(expr, Condition):
        operator = {"is": "!=", "not": "=="}.get(expr.operator, expr.operator)
        if operator not in OPERATORS:
            raise ValueError(f"Expected an operator of conditions, found {expr.operator!r}.")
        number = of_number(expr.number)
        right = side_source(expr.other, of_key) if expr.other else number
        return f"({side_source(expr.key, of_key)} {operator} {right})"
    parts = [source(part, of_key, of_number) for part in expr.parts]
    return f"(not {parts[0]})" if expr.word == "not" else f"({f' {expr.word} '.join(parts)})"


def side_source(side: str, of_key: Callable[[str], str]) -> str:
    """A key or a Formula as Python source."""
    return python(side.term if isinstance(side, Formula) else side, of_key)


@lru_cache(maxsize=1024)
def _compiled(expression: str) -> Callable[[Board], Callable[[], Any]]:
    # One closure for all parts: one call per part would make a tick two to five times slower.
    function: Callable[[Board], Callable[[], Any]] = eval(
        f"lambda board: lambda: {expression}", {"__builtins__": {}, "divide": divide}
    )
    return function
