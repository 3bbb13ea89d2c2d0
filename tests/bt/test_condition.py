"""Conditions: compiled, compared, shortened and written as a slow interpreter reads them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given

from islandgp.bt.analysis.satisfiability import excludes, implies, shortened
from islandgp.bt.core.condition import (
    Compound,
    Condition,
    ConditionExpr,
    combine,
    condition,
    negate,
    opposite,
    terms,
    to_nnf,
    with_term,
)
from islandgp.bt.core.language import parse, parse_condition, to_text
from islandgp.bt.core.node import Limits, guard_of, guarded, leaf, walk
from islandgp.bt.core.printer import condition_text
from islandgp.bt.export.behaviortree_cpp import _script
from islandgp.bt.export.scripts import read_condition
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.gp.random_trees import TreeSpace, random_tree
from islandgp.gp.variation import mutate
from tests.bt.reference import holds
from tests.composed import composed
from tests.profiles import examples
from tests.strategies import conditions, few_boards, few_numbers

PLACES = VOCABULARY.key_index
EXPRESSIONS = conditions(few_numbers(), pairs=True)
P, Q = Condition("foundGarbage", "is", 0.0), Condition("isHumanoidWantToClear", "is", 0.0)
LOW = Condition("batteryLevel", "<", 2.0)

VALUES = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]
"""One of each stretch of the numbers of `few_numbers`, and these numbers."""


def boards(*expressions: ConditionExpr) -> list[list[float]]:
    """All blackboards on which the conditions can differ."""
    keys = {key for each in expressions for term in terms(each) for key in term.keys}
    each_key = [
        ([0.0, 1.0] if key.flag else VALUES) if name in keys else [0.0]
        for name, key in VOCABULARY.keys.items()
    ]
    return [list(values) for values in product(*each_key)]


@examples(max_examples=300)
@given(expr=EXPRESSIONS, board=few_boards())
def test_a_compiled_condition_equals_the_interpreter(
    expr: ConditionExpr, board: list[float]
) -> None:
    """Also after the board has changed, and for opposite, negated and normal forms."""
    other_board = list(board)
    compiled = condition(expr, other_board, PLACES)
    assert compiled() is holds(expr, board, PLACES)
    assert condition(to_nnf(expr), board, PLACES)() is compiled()
    for opposed in (opposite(expr), negate(expr)):
        assert condition(opposed, board, PLACES)() is not compiled()
    other_board[:] = [1 - value for value in board]
    assert compiled() is holds(expr, other_board, PLACES)


@examples(max_examples=150, deadline=None)
@given(first=EXPRESSIONS, second=EXPRESSIONS)
def test_what_follows(first: ConditionExpr, second: ConditionExpr) -> None:
    """What one condition implies or excludes, it does on every blackboard, and it is all found."""
    truths = [(holds(first, b, PLACES), holds(second, b, PLACES)) for b in boards(first, second)]
    followed = not any(a and not b for a, b in truths)
    assert not implies((first,), second) or followed
    assert not excludes((first,), second) or not any(a and b for a, b in truths)
    term_lists = [[*terms(each)] for each in (first, second)]
    if max(map(len, term_lists)) < 4 and not any(
        not term.single for each in term_lists for term in each
    ):
        assert implies((first,), second) == followed


def test_a_not_in_an_or_denies() -> None:
    """`foundGarbage or not lap < 3` holds where lap is 5: the `not` is no word to pass over."""
    premise = parse_condition("not foundGarbage and lap >= 5", VOCABULARY)
    expr = parse_condition("foundGarbage or not lap < 3", VOCABULARY)
    assert not excludes((premise,), expr)
    assert implies((premise,), expr)


@examples(max_examples=150, deadline=None)
@given(expr=EXPRESSIONS, premise=EXPRESSIONS)
def test_shorter(expr: ConditionExpr, premise: ConditionExpr) -> None:
    """A shorter condition is the same where what is known holds, and shortening it ends there."""
    shorter = shortened(expr, (premise,))
    assert shortened(shorter, (premise,)) == shorter
    for board in boards(expr, premise):
        if holds(premise, board, PLACES):
            assert holds(shorter, board, PLACES) == holds(expr, board, PLACES)


@pytest.mark.parametrize(
    ("text", "short"),
    [
        ("not not not foundGarbage", "not foundGarbage"),
        ("not lap < 3", "lap >= 3"),
        ("not (foundGarbage or lap < 3)", "not (foundGarbage or lap < 3)"),
        ("not (lap > 1 and lap < 3)", "lap <= 1 or lap >= 3"),
        ("foundGarbage and foundGarbage", "foundGarbage"),
        ("lap < 3 and lap < 5", "lap < 3"),
        ("lap < 3 or lap < 5", "lap < 5"),
        ("lap < 3 and lap > 4 or foundGarbage", "foundGarbage"),
        ("foundGarbage or not foundGarbage and lap > 1", "foundGarbage or lap > 1"),
        ("foundGarbage and (foundGarbage or lap > 1)", "foundGarbage"),
        ("lap >= 3 and lap <= 3", "lap >= 3 and lap <= 3"),
    ],
)
def test_shorter_examples(text: str, short: str) -> None:
    """Double negation, De Morgan, repeated terms, and terms that decide nothing."""
    expr = parse_condition(text, VOCABULARY)
    assert condition_text(shortened(expr, ())) == short


@examples(max_examples=200)
@given(expr=conditions(pairs=True))
def test_ways_out_and_back(expr: ConditionExpr) -> None:
    """Text, JSON and scripts of BehaviorTree.CPP bring a condition back."""
    tree = guarded(expr, leaf("PatrolWaypoint"))
    assert parse(to_text(tree), VOCABULARY) == tree
    assert parse_condition(condition_text(expr), VOCABULARY) == expr
    assert read_condition(_script(expr), VOCABULARY) == expr


def test_scripts_bind_equally() -> None:
    """In BehaviorTree.CPP && does not bind more than ||."""
    text = "foundGarbage || lap < 3 && isHumanoidWantToClear"
    three = Condition("lap", "<", 3.0)
    assert read_condition(text, VOCABULARY) == combine("and", [combine("or", [P, three]), Q])
    assert parse_condition("foundGarbage or lap < 3 and isHumanoidWantToClear", VOCABULARY) == (
        combine("or", [P, combine("and", [three, Q])])
    )


def test_terms_change_places() -> None:
    """A single condition of a joined one can be replaced and taken out."""
    joined = combine("or", [P, negate(combine("and", [Q, LOW]))])
    assert with_term(joined, 2, P) == combine("or", [P, negate(combine("and", [Q, P]))])
    assert with_term(joined, 1, None) == combine("or", [P, Compound("not", (LOW,))])
    assert with_term(joined, 0, None) == negate(combine("and", [Q, LOW]))
    assert with_term(P, 0, None) is None


def test_random_trees_have_single_conditions() -> None:
    """As in the paper; they read back as they are printed."""
    gp = composed().gp
    space = TreeSpace(gp.trees, VOCABULARY, Limits(gp.max_depth, gp.max_nodes))
    for seed in range(100):
        tree = random_tree(np.random.default_rng(seed), space)
        assert all(isinstance(n.args[0], Condition) for n in walk(tree) if n.guard)
        assert parse(to_text(tree), VOCABULARY) == tree


def test_mutation_of_joined_conditions() -> None:
    """A joined condition that somebody injected is mutated in part, and never grows."""
    gp = composed().gp
    space = TreeSpace(gp.trees, VOCABULARY, Limits(gp.max_depth, gp.max_nodes))
    tree = parse("when batteryLevel < 20 and not (foundGarbage or lap > 1) { PatrolWaypoint }")
    only = gp.mutation.model_copy(update={"operators": {"parameter": 1.0}})
    sizes: set[int] = set()
    for seed in range(200):
        rng = np.random.default_rng(seed)
        new, _ = mutate(rng, tree, rate=1.0, space=space, settings=only)
        sizes.add(len(list(terms(guard_of(new).condition))))
        assert parse(to_text(new), VOCABULARY) == new
    assert sizes == {2, 3}
