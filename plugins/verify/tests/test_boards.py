"""Sets of blackboards as diagrams."""

from __future__ import annotations

from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from islandgp.bt.core.condition import Condition, ConditionExpr, combine, condition, opposite
from islandgp.bt.core.language import parse_condition
from islandgp.bt.core.vocabulary import Key, Vocabulary, flag, integer, number
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp_verify import boards
from islandgp_verify.boards import ANY_BOARD, NO_BOARD, BoardSets
from tests.strategies import conditions, few_boards, few_numbers

PLACES = VOCABULARY.key_index


def island(text: str) -> ConditionExpr:
    """A condition of the island."""
    return parse_condition(text, VOCABULARY)


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("n > 3 and n < 4", []),
        ("n > 3 and n <= 4", [4]),
        ("n >= 2 and n != 2 and n < 4", [3]),
        ("n == 0 or n > 8", [0, 9]),
    ],
)
def test_sets_of_whole_numbers(text: str, holds: list[int]) -> None:
    """Nothing lies between two whole numbers; each number that a condition allows is in its set."""
    vocabulary = Vocabulary("d", {}, {"n": integer("how many", 0, 9, most=9)})
    sets = BoardSets(vocabulary.keys)
    allowed = sets.of(parse_condition(text, vocabulary))
    assert [n for n in range(10) if sets.has(allowed, [n])] == holds
    assert (allowed == NO_BOARD) == (not holds)
    assert (sets.pick(allowed) in [[n] for n in holds]) == bool(holds)


@settings(deadline=None)
@given(conditions(few_numbers()), conditions(few_numbers()), few_boards())
def test_sets_hold_where_their_conditions_do(
    one: ConditionExpr, other: ConditionExpr, board: list[float]
) -> None:
    """A blackboard is in the set of a condition where that holds; and, or, not likewise."""
    sets = BoardSets(VOCABULARY.keys)
    a, b = sets.of(one), sets.of(other)
    in_a, in_b = condition(one, board, PLACES)(), condition(other, board, PLACES)()
    assert sets.has(a, board) == in_a
    assert sets.has(sets.of(opposite(one)), board) != in_a
    assert sets.has(sets.both(a, b), board) == (in_a and in_b)
    assert sets.has(sets.either(a, b), board) == (in_a or in_b)
    assert sets.exact


@settings(deadline=None)
@given(conditions(few_numbers()), conditions(few_numbers()), few_boards())
def test_equal_sets_are_one(one: ConditionExpr, other: ConditionExpr, near: list[float]) -> None:
    """Sets have one form each: what holds nowhere is NO_BOARD, what always holds ANY_BOARD."""
    sets = BoardSets(VOCABULARY.keys)
    a, b = sets.of(one), sets.of(other)
    assert sets.both(a, b) == sets.of(combine("and", [other, one]))
    assert sets.both(a, sets.of(opposite(one))) == NO_BOARD
    assert sets.either(a, sets.of(opposite(one))) == ANY_BOARD
    board = sets.pick(sets.both(a, b), near)
    if board is None:
        assert sets.both(a, b) == NO_BOARD
    else:
        for value, key in zip(board, VOCABULARY.keys.values(), strict=True):
            assert key.low <= value <= (inf if key.most is None else key.most)
        assert condition(one, board, PLACES)()
        assert condition(other, board, PLACES)()


@pytest.mark.parametrize(
    ("text", "boards"),
    [
        ("batteryLevel >= 0", ANY_BOARD),
        ("batteryLevel <= 100", ANY_BOARD),
        ("batteryLevel < 0", NO_BOARD),
        ("batteryLevel > 100", NO_BOARD),
        ("batteryLevel == 101", NO_BOARD),
        ("lap != -1", ANY_BOARD),
        ("lap < 2 or lap >= 2", ANY_BOARD),
        ("foundGarbage and not foundGarbage", NO_BOARD),
    ],
)
def test_ranges(text: str, boards: int) -> None:
    """Only values in the ranges of the vocabulary count."""
    assert BoardSets(VOCABULARY.keys).of(island(text)) == boards


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("batteryLevel < 10", 5),
        ("batteryLevel > 20 and batteryLevel < 21", 20.5),
        ("batteryLevel == 12.5", 12.5),
        ("batteryLevel >= 100", 100),
        ("batteryLevel < 80", 50),
        ("batteryLevel != 50", 25),
    ],
)
def test_values_that_are_picked(text: str, value: float) -> None:
    """The middle of the range if it may be; else a whole number near the middle of what may."""
    sets = BoardSets(VOCABULARY.keys)
    board = sets.pick(sets.of(island(text)))
    assert board is not None
    assert board[PLACES["batteryLevel"]] == value


def test_a_board_is_picked_near_to_another() -> None:
    """Values that may stay do."""
    sets = BoardSets(VOCABULARY.keys)
    near = [33.0, 4.0, 7.0, 1.0, 0.0]
    assert sets.pick(sets.of(island("lap > 2 and foundGarbage")), near) == near
    changed = sets.pick(sets.of(island("lap > 8 and foundGarbage")), near)
    assert changed is not None
    assert [a for a, b in zip(changed, near, strict=True) if a != b] == [9.0]


def test_keys_without_a_range() -> None:
    """Values of any size can be picked."""
    sets = BoardSets({"x": Key("", flag=False, low=-inf), "p": flag("")})
    for text, value in (("x < -1000000", -1_000_001), ("x > 1000000", 1_000_001), ("x != 0", -1)):
        name, operator, threshold = text.split()
        board = sets.pick(sets.of(Condition(name, operator, float(threshold))))
        assert board == [value, 0.0]


@given(st.integers(1, 40))
def test_too_much_work_gives_a_larger_set(steps: int) -> None:
    """Within a bound; then the sets are not exact any more."""
    keys = {f"x{i}": number("", 0, 9) for i in range(12)}
    pairs = [
        combine("and", [Condition(f"x{i}", "<", 1.0), Condition(f"x{i + 6}", "<", 1.0)])
        for i in range(6)
    ]
    expr = combine("or", pairs)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(boards, "MAX_STEPS", steps)
        sets = BoardSets(keys)
        positive, negative = sets.of(expr), sets.of(opposite(expr))
        assert not sets.exact
    low, high = [0.0] * 12, [5.0] * 12
    assert sets.has(positive, low)
    assert sets.has(negative, high)
    assert BoardSets(keys).of(expr) > ANY_BOARD
