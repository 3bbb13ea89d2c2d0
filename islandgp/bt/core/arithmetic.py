"""Numbers in trees, and arithmetic with keys: `0.5 * angle + spin`."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from decimal import Decimal
from math import inf, isnan
from operator import add, mul, sub, truediv
from typing import Any, Final, NamedTuple, Self, TypeAlias

SIGNS: Final = ("+", "-", "*", "/")
_UNARY: Final = 3  # precedence, above that of sums (1) and products (2)


class Written(float):
    """A number of a text, with its word."""

    word: Any = None  # a `source.Word`

    def __new__(cls, value: float, word: Any = None) -> Self:
        written = super().__new__(cls, value)
        written.word = word
        return written


class Named(Written):
    """A number that is printed as a name: of a constant or parameter, or a word of a key."""

    name: str

    def __new__(cls, name: str, value: float, word: Any = None) -> Self:
        named = super().__new__(cls, value, word)
        named.name = name
        return named

    def __getnewargs__(self) -> tuple[str, float]:  # type: ignore[override]  # for pickle
        return self.name, float(self)


def number_text(value: float) -> str:
    """A number without exponent and trailing zeros, `25`, `12.5`, or its name."""
    if isinstance(value, Named):  # in an export, a word has single quotes
        is_word = value.name.isidentifier() or value.name[:1] == "'"
        return value.name if is_word else f'"{value.name}"'
    if value == int(value):
        return str(int(value))
    return format(Decimal(repr(float(value))), "f")


class Operation(NamedTuple):
    """A sum, a difference, a product or a quotient of two terms, or the negative of one."""

    sign: str  # of SIGNS
    parts: tuple[Term, ...]


Term: TypeAlias = "float | str | Operation"  # a number, a key, or an operation on terms


class Formula(str):
    """An operation on keys and numbers as canonical text, `0.5 * angle + spin`.

    In a condition it is in the place of a key.
    """

    term: Term

    def __new__(cls, term: Term) -> Self:
        formula = super().__new__(cls, _text(term, 0))
        formula.term = term
        return formula

    def __getnewargs__(self) -> tuple[Term]:  # type: ignore[override]  # for pickle
        return (self.term,)

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that it reads, in order, each once."""
        return tuple(dict.fromkeys(leaf for leaf in _leaves(self.term) if isinstance(leaf, str)))

    @property
    def divides(self) -> bool:
        """True if it divides by a key, so that it may be no number, with which nothing compares."""
        return _divides(self.term)


def side(term: Term) -> str:
    """A term that is no number, as a side of a comparison: a key or a Formula."""
    return term if isinstance(term, str) else Formula(term)


def negative(term: Term) -> Term:
    """The negative of a term."""
    if isinstance(term, Operation) and len(term.parts) == 1:
        return term.parts[0]
    return Operation("-", (term,)) if isinstance(term, str | Operation | Named) else 0.0 - term


def divide(x: float, y: float) -> float:
    """x / y by IEEE 754: a division by 0 gives an infinity, 0 / 0 no number."""
    if y:
        return x / y
    return x * math.copysign(math.inf, y) if x else math.nan


def python(term: Term, of_key: Callable[[str], str]) -> str:
    """Python source of a term, which calls `divide`; `of_key`: the source of a key's value."""
    if isinstance(term, str):
        return of_key(term)
    if not isinstance(term, Operation):
        return repr(float(term))
    parts = [python(part, of_key) for part in term.parts]
    if _by_key(term):
        return f"divide({', '.join(parts)})"
    return f"({f' {term.sign} '.join(parts)})" if len(parts) > 1 else f"(-{parts[0]})"


def bounds(term: Term, ranges: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """A lowest and a highest value of a term for keys in their ranges, in floating point.

    Rounding to the nearest is monotone, so that the bounds hold to the last bit.
    """
    if isinstance(term, str):
        return ranges.get(term, (-inf, inf))
    if not isinstance(term, Operation):
        return term, term
    first, *others = (bounds(part, ranges) for part in term.parts)
    if not others:
        return -first[1], -first[0]
    if term.sign == "/" and not (min(others[0]) > 0 or max(others[0]) < 0):
        return -inf, inf
    apply = {"+": add, "-": sub, "*": mul, "/": truediv}[term.sign]
    ends = [apply(x, y) for x in first for y in others[0]]
    return (-inf, inf) if any(map(isnan, ends)) else (min(ends), max(ends))


def is_whole(term: Term, keys: Collection[str]) -> bool:
    """True if the value of a term is a whole number, as those of `keys` are."""
    if isinstance(term, Operation):
        return term.sign != "/" and all(is_whole(part, keys) for part in term.parts)
    return term in keys if isinstance(term, str) else term % 1 == 0


def numbers_in(term: Term) -> list[float]:
    """The numbers of a term, in order."""
    return [leaf for leaf in _leaves(term) if not isinstance(leaf, str)]


def with_numbers(term: Term, numbers: Iterator[float]) -> Term:
    """The term with other numbers, which are taken in order."""
    if isinstance(term, Operation):
        return Operation(term.sign, tuple([with_numbers(part, numbers) for part in term.parts]))
    return term if isinstance(term, str) else next(numbers)


def _text(term: Term, level: int) -> str:
    """A term as text, in brackets if it binds less than the operation around it."""
    if not isinstance(term, Operation):
        return term if isinstance(term, str) else number_text(term)
    if len(term.parts) == 1:
        return f"-{_text(term.parts[0], _UNARY)}"
    own = 1 if term.sign in "+-" else 2
    text = f"{_text(term.parts[0], own)} {term.sign} {_text(term.parts[1], own + 1)}"
    return f"({text})" if own < level else text


def _leaves(term: Term) -> Iterator[float | str]:
    if isinstance(term, Operation):
        for part in term.parts:
            yield from _leaves(part)
    else:
        yield term


def _divides(term: Term) -> bool:
    if not isinstance(term, Operation):
        return False
    return _by_key(term) or any(map(_divides, term.parts))


def _by_key(term: Operation) -> bool:
    return term.sign == "/" and any(isinstance(leaf, str) for leaf in _leaves(term.parts[1]))
