"""Conditions: compiled, compared, shortened and written as a slow interpreter reads them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given

from islandgp.bt.analysis.truth import excludes, implies, shortened
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
from islandgp.bt.export.json import from_json, to_json
from islandgp.bt.export.scripts import read_condition
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.gp.random_trees import ConditionSettings, TreeSpace, random_tree
from islandgp.gp.variation import mutate
from tests.bt.reference import holds
from tests.composed import composed
from tests.profiles import examples
from tests.strategies import conditions, few_boards, few_numbers

PLACES = VOCABULARY.places
ASKED = conditions(few_numbers(), pairs=True)
P, Q = Condition("foundGarbage", "is", 0.0), Condition("isHumanoidWantToClear", "is", 0.0)
LOW = Condition("batteryLevel", "<", 2.0)

VALUES = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5]
"""One of each stretch of the numbers of `few_numbers`, and these numbers."""


def boards(*asked: ConditionExpr) -> list[list[float]]:
    """All blackboards that conditions can tell apart."""
    keys = {key for each in asked for term in terms(each) for key in term.keys}
    each_key = [
        ([0.0, 1.0] if key.flag else VALUES) if name in keys else [0.0]
        for name, key in VOCABULARY.keys.items()
    ]
    return [list(values) for values in product(*each_key)]


@examples(max_examples=300)
@given(asked=ASKED, board=few_boards())
def test_one_closure_says_what_the_interpreter_says(
    asked: ConditionExpr, board: list[float]
) -> None:
    """Also after the board has changed, and for what is opposite, denied and spread."""
    other = list(board)
    compiled = condition(asked, other, PLACES)
    assert compiled() is holds(asked, board, PLACES)
    assert condition(to_nnf(asked), board, PLACES)() is compiled()
    for against in (opposite(asked), negate(asked)):
        assert condition(against, board, PLACES)() is not compiled()
    other[:] = [1 - value for value in board]
    assert compiled() is holds(asked, other, PLACES)


def test_a_single_condition_stays_what_it_was() -> None:
    """Its closure reads the board and compares: nothing is compiled, nothing else is called."""
    compiled = condition(LOW, [1.0] * 5, PLACES)
    assert compiled.__code__.co_names == ()
    joined_up = condition(combine("and", [LOW, P]), [1.0] * 5, PLACES)
    assert joined_up.__code__.co_names == ()
    assert joined_up.__code__.co_freevars == ("board",)


@examples(max_examples=150, deadline=None)
@given(first=ASKED, second=ASKED)
def test_what_follows(first: ConditionExpr, second: ConditionExpr) -> None:
    """What one condition implies or excludes, it does on every blackboard, and it is all found."""
    found = [(holds(first, b, PLACES), holds(second, b, PLACES)) for b in boards(first, second)]
    followed = not any(a and not b for a, b in found)
    assert not implies((first,), second) or followed
    assert not excludes((first,), second) or not any(a and b for a, b in found)
    asked = [[*terms(each)] for each in (first, second)]
    if max(map(len, asked)) < 4 and not any(term.other for each in asked for term in each):
        assert implies((first,), second) == followed


def test_a_not_in_an_or_denies() -> None:
    """`foundGarbage or not lap < 3` holds where lap is 5: the `not` is no word to pass over."""
    known = parse_condition("not foundGarbage and lap >= 5", VOCABULARY)
    asked = parse_condition("foundGarbage or not lap < 3", VOCABULARY)
    assert not excludes((known,), asked)
    assert implies((known,), asked)


@examples(max_examples=150, deadline=None)
@given(asked=ASKED, known=ASKED)
def test_shorter(asked: ConditionExpr, known: ConditionExpr) -> None:
    """A shorter condition is the same where what is known holds, and shortening it ends there."""
    found = shortened(asked, (known,))
    assert shortened(found, (known,)) == found
    for board in boards(asked, known):
        if holds(known, board, PLACES):
            assert holds(found, board, PLACES) == holds(asked, board, PLACES)


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
    """Double negation, De Morgan, what is said twice, and what decides nothing."""
    asked = parse_condition(text, VOCABULARY)
    assert condition_text(shortened(asked, ())) == short


@examples(max_examples=200)
@given(asked=conditions(pairs=True))
def test_ways_out_and_back(asked: ConditionExpr) -> None:
    """Text, JSON and scripts of BehaviorTree.CPP bring a condition back."""
    tree = guarded(asked, leaf("PatrolWaypoint"))
    assert parse(to_text(tree), VOCABULARY) == tree
    assert from_json(to_json(tree)) == tree
    assert parse_condition(condition_text(asked), VOCABULARY) == asked
    assert read_condition(_script(asked), VOCABULARY) == asked


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
    asked = combine("or", [P, negate(combine("and", [Q, LOW]))])
    assert with_term(asked, 2, P) == combine("or", [P, negate(combine("and", [Q, P]))])
    assert with_term(asked, 1, None) == combine("or", [P, Compound("not", (LOW,))])
    assert with_term(asked, 0, None) == negate(combine("and", [Q, LOW]))
    assert with_term(P, 0, None) is None


def test_evolution_joins_conditions_where_it_may() -> None:
    """`gp.trees.conditions` makes them, mutation changes them, and they stay in their bounds."""
    gp = composed().gp
    limits = Limits(gp.max_depth, gp.max_nodes)
    usual = TreeSpace(gp.trees, VOCABULARY, limits)
    how = gp.trees.model_copy(update={"conditions": ConditionSettings(joined=0.5, terms=4)})
    space = TreeSpace(how, VOCABULARY, limits)
    sizes: set[int] = set()
    for seed in range(300):
        rng = np.random.default_rng(seed)
        tree = random_tree(rng, space)
        for _ in range(5):
            tree, _ = mutate(rng, tree, rate=1.0, space=space, settings=gp.mutation)
        asked = [guard_of(node).condition for node in walk(tree) if node.guard]
        sizes.update(len(list(terms(each))) for each in asked)
        assert parse(to_text(tree), VOCABULARY) == tree
        plain = random_tree(np.random.default_rng(seed), usual)
        assert all(isinstance(n.args[0], Condition) for n in walk(plain) if n.guard)
    assert sizes == {1, 2, 3, 4}


def test_mutation_of_joined_conditions_without_configuration() -> None:
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
