"""Sets of blackboards, as decision diagrams.

A diagram tests one key after the other, in the order of the vocabulary, and splits the values of a
key at the numbers that conditions compare it with. Equal sets have equal diagrams. So the empty set
is recognised immediately, and a member of any other set can be read off its diagram.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from math import floor, inf
from sys import maxsize
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.core.condition import Condition, ConditionExpr, ordered, rounded, to_nnf
from islandgp.bt.core.vocabulary import Key

Boards: TypeAlias = int
"""A set of blackboards: the number of its diagram in a `BoardSets`."""

NO_BOARD: Final[Boards] = 0
ANY_BOARD: Final[Boards] = 1
"""All blackboards whose values are in the ranges of their keys."""

MAX_STEPS: Final = 20_000  # to join two sets; beyond it, the result is a superset
ALL_STEPS: Final = 300_000  # to join all sets of a BoardSets

Cut: TypeAlias = tuple[float, int]
"""A place between two values of a key: (x, 0) is just below x, (x, 1) just above it."""


class _Diagram(NamedTuple):
    """A decision node: splits the values of a key into parts and has a set for each part."""

    key: int
    cuts: tuple[Cut, ...]  # ascending
    parts: tuple[Boards, ...]  # one more than cuts; neighbours differ


class _TooLargeError(Exception):
    """A set takes too many steps to compute."""


class BoardSets:
    """Sets of the blackboards of some keys.

    The work is bounded: if a join takes too many steps, the result is a superset of the correct
    set, and `exact` becomes False. A comparison of two keys is also inexact: their difference is
    treated as one more key, independent of the two.
    """

    def __init__(self, keys: Mapping[str, Key]) -> None:
        self.exact = True
        self.key_index = {name: index for index, name in enumerate(keys)}
        self._keys = tuple(keys.values())
        self._ranges = [_range(key) for key in self._keys]
        self._differences: dict[tuple[str, ...], int] = {}
        self._usual = [_usual(key) for key in self._keys]
        self._diagrams = [_Diagram(maxsize, (), ()), _Diagram(maxsize, (), ())]
        self._numbers: dict[_Diagram, Boards] = {}
        self._joined: dict[tuple[Boards, Boards, Boards], Boards] = {}
        self._steps_left = ALL_STEPS
        self._room = 0  # remaining steps of the present join

    def of(self, expr: ConditionExpr) -> Boards:
        """The blackboards on which a condition holds."""
        return self._of(to_nnf(expr))

    def both(self, *sets: Boards) -> Boards:
        """The blackboards that are in all of these sets."""
        result = ANY_BOARD
        for boards in sets:
            if result != boards:  # most joins return one of their arguments
                result = self._join(result, boards, NO_BOARD, result)
        return result

    def either(self, *sets: Boards) -> Boards:
        """The blackboards that are in one of these sets."""
        result = NO_BOARD
        for boards in sets:
            if result != boards:
                result = self._join(result, boards, ANY_BOARD, ANY_BOARD)
        return result

    def has(self, boards: Boards, board: Sequence[float]) -> bool:
        """True if a blackboard is in a set."""
        while boards > ANY_BOARD:
            diagram = self._diagrams[boards]
            boards = diagram.parts[_part(diagram.cuts, board[diagram.key])]
        return boards == ANY_BOARD

    def pick(self, boards: Boards, near: Sequence[float] = ()) -> list[float] | None:
        """A blackboard in a set; None for the empty set.

        Args:
            boards: the set.
            near: another blackboard, whose values are kept if possible. Default: values in the
                middle of the ranges.
        """
        if boards == NO_BOARD:
            return None
        board = list(near or self._usual)
        while boards > ANY_BOARD:
            key, cuts, parts = self._diagrams[boards]
            current = _part(cuts, board[key])
            filled = [at for at, part in enumerate(parts) if part != NO_BOARD]
            at = min(filled, key=lambda at: (abs(at - current), at))
            if at != current:
                board[key] = self._value(key, ((-inf, 0), *cuts, (inf, 1))[at : at + 2])
            boards = parts[at]
        return board

    def _value(self, place: int, between: Sequence[Cut]) -> float:
        """A value of a key between two cuts: a whole number if there is one."""
        if self._keys[place].flag:
            return float(between[0] >= (0.0, 1))
        low, high = self._ranges[place]
        return _between(max(between[0], low), min(between[1], high))

    def _of(self, expr: ConditionExpr) -> Boards:
        if isinstance(expr, Condition):
            return self._single(expr)
        if expr.word == "not":  # of a division by a key
            self.exact = False
            return ANY_BOARD
        parts = [self._of(part) for part in expr.parts]
        return self.both(*parts) if expr.word == "and" else self.either(*parts)

    def _single(self, expr: Condition) -> Boards:
        expr, empty, full = ordered(expr), NO_BOARD, ANY_BOARD
        if expr.single and self._keys[self.key_index[expr.key]].whole:
            expr = rounded(expr)
            if expr.number % 1:  # == or != with a number that is not whole
                return empty if expr.operator == "==" else full
        x = float(expr.number)
        cuts: tuple[Cut, ...]
        cuts, parts = {
            "<": (((x, 0),), (full, empty)),
            "<=": (((x, 1),), (full, empty)),
            ">": (((x, 1),), (empty, full)),
            ">=": (((x, 0),), (empty, full)),
            "==": (((x, 0), (x, 1)), (empty, full, empty)),
            "!=": (((x, 0), (x, 1)), (full, empty, full)),
            "is": (((x, 1),), (empty, full)),
            "not": (((x, 1),), (full, empty)),
        }[expr.operator]
        if not expr.single:  # the difference of both sides is one more key
            self.exact = False
            index = len(self._keys) + len(self._differences)
            index = self._differences.setdefault((expr.key, expr.other), index)
            return self._number(index, cuts, parts)
        index = self.key_index[expr.key]
        if self._keys[index].whole:  # above 3 is the same as from 4 on
            cuts = tuple((x + 1, 0) if above and x % 1 == 0 else (x, above) for _, above in cuts)
        low, high = self._ranges[index]
        while cuts and cuts[0] <= low:
            cuts, parts = cuts[1:], parts[1:]
        while cuts and cuts[-1] >= high:
            cuts, parts = cuts[:-1], parts[:-1]
        return self._number(index, cuts, parts)

    def _join(self, a: Boards, b: Boards, absorbing: Boards, otherwise: Boards) -> Boards:
        """Intersection (`absorbing` NO_BOARD) or union; `otherwise` if it takes too many steps."""
        if absorbing in (a, b):
            return absorbing
        if a == 1 - absorbing:
            return b
        if b == 1 - absorbing:
            return a
        self._room = min(MAX_STEPS, self._steps_left)
        before = self._room
        try:
            return self._merge(a, b, absorbing)
        except _TooLargeError:
            self.exact = False
            return otherwise
        finally:
            self._steps_left -= before - self._room

    def _merge(self, a: Boards, b: Boards, absorbing: Boards) -> Boards:
        if a == b or b == 1 - absorbing:
            return a
        if a == 1 - absorbing:
            return b
        if absorbing in (a, b):
            return absorbing
        pair = (min(a, b), max(a, b), absorbing)
        merged = self._joined.get(pair)
        if merged is None:
            if self._room <= 0:
                raise _TooLargeError
            self._room -= 1
            merged = self._joined[pair] = self._merged(a, b, absorbing)
        return merged

    def _merged(self, a: Boards, b: Boards, absorbing: Boards) -> Boards:
        one, other = self._diagrams[a], self._diagrams[b]
        if one.key > other.key:
            a, b, one, other = b, a, other, one
        if one.key < other.key:
            return self._number(
                one.key, one.cuts, [self._merge(part, b, absorbing) for part in one.parts]
            )
        cuts = tuple(sorted({*one.cuts, *other.cuts}))
        i = j = 0
        parts = [self._merge(one.parts[0], other.parts[0], absorbing)]
        for cut in cuts:
            i += i < len(one.cuts) and one.cuts[i] == cut
            j += j < len(other.cuts) and other.cuts[j] == cut
            parts.append(self._merge(one.parts[i], other.parts[j], absorbing))
        self._room -= len(cuts)
        return self._number(one.key, cuts, parts)

    def _number(self, key: int, cuts: Sequence[Cut], parts: Sequence[Boards]) -> Boards:
        """The number of a diagram in canonical form."""
        borders = [at for at in range(len(cuts)) if parts[at] != parts[at + 1]]
        if not borders:
            return parts[0]
        diagram = _Diagram(
            key, tuple(cuts[at] for at in borders), (*(parts[at] for at in borders), parts[-1])
        )
        if diagram not in self._numbers:
            self._numbers[diagram] = len(self._diagrams)
            self._diagrams.append(diagram)
        return self._numbers[diagram]


def _range(key: Key) -> tuple[Cut, Cut]:
    """The cuts below the least and above the greatest value of a key."""
    if key.flag:
        return (0.0, 0), (1.0, 1)
    return (key.low, 0), (inf if key.most is None else key.most, 1)


def _usual(key: Key) -> float:
    """A value in the middle of a key's range."""
    if key.flag:
        return 0.0
    low, high = _range(key)
    return _between(low, min(high, (key.high, 1)))


def _between(low: Cut, high: Cut) -> float:
    """A value between two cuts: a whole number if there is one, and about in the middle."""
    if high[0] == inf:
        if low[0] == -inf:
            return 0.0
        first = float(floor(low[0]))
        return first if low < (first, 0.5) else first + 1.0
    if low[0] == -inf:
        return -floor(-high[0]) - 1.0
    middle = (low[0] + high[0]) / 2
    integer = float(floor(middle))
    return next((value for value in (integer, integer + 1) if low < (value, 0.5) < high), middle)


def _part(cuts: Sequence[Cut], value: float) -> int:
    """Number of cuts below a value."""
    return bisect_right(cuts, (value, 0.5))
