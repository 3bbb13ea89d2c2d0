"""Arithmetic in conditions: `when 0.5 * angle + spin > 0.1`."""

from __future__ import annotations

import pickle
import re
from itertools import product
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.analysis.satisfiability import excludes, implies
from islandgp.bt.core.arithmetic import Formula
from islandgp.bt.core.condition import Condition, ConditionExpr, terms
from islandgp.bt.core.language import parse, parse_condition, to_text
from islandgp.bt.core.node import guard_of, guarded, keys_in, leaf, thresholds
from islandgp.bt.core.printer import condition_text
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag, number
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.scripts import read_condition
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import LimitError, TreeError
from islandgp.gp.branches import places_of_numbers, tune
from islandgp.gp.variation import MutationSettings
from tests.bt.reference import holds
from tests.profiles import examples
from tests.search.searches import search_and_plan
from tests.strategies import conditions

WORDS = Vocabulary(
    "robot",
    {"Go": Action("")},
    {
        "angle": number("", -5, 5),
        "spin": number("", -5, 5),
        "speed": number("", 0, 2, most=2),
        "held": flag(""),
        "mode": enumeration("", ("idle", "busy")),
    },
)


def read(condition: str) -> Condition:
    expr = guard_of(parse(f"when {condition} {{ Go }}", WORDS)).condition
    assert isinstance(expr, Condition)
    return expr


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("0.5*angle+spin>0.1", "0.5 * angle + spin > 0.1"),
        ("angle -3 > spin", "angle - 3 > spin"),
        ("angle-3>0", "angle - 3 > 0"),
        ("(angle) < (3)", "angle < 3"),
        ("- -angle < - -3", "angle < 3"),
        ("-(angle + 1) * 2 >= -spin", "-(angle + 1) * 2 >= -spin"),
        ("angle - (spin - 1) > 0", "angle - (spin - 1) > 0"),
        ("(angle - spin) - 1 > 0", "angle - spin - 1 > 0"),
        ("angle / (spin * 2) < 2 * speed", "angle / (spin * 2) < 2 * speed"),
        ("angle * 3 < spin", "angle * 3 < spin"),
        ("angle < -(2)", "angle < -2"),
    ],
)
def test_canonical_text(text: str, canonical: str) -> None:
    """Blanks and needless brackets go; the order of the operations stays."""
    expr = read(text)
    assert condition_text(expr) == canonical
    assert read(canonical) == expr
    assert pickle.loads(pickle.dumps(expr)) == expr


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2 < angle", "1:6: unexpected '2'"),
        ("2 * 3 < angle", "Expected a key"),
        ("angle + spin", "a sum must be compared"),
        ("held + 1 > 2", "held is a flag and does not fit"),
        ("angle > mode + 1", "mode is one of idle, busy and does not fit"),
        ("angle / (2 - 2) > 1", "division by 0"),
        ("(held and held) * 2 > 1", "a condition can't be a part of a sum"),
        ("angle > wind * 2", "unknown blackboard key 'wind'"),
        ("angle + > 3", "unexpected '>'"),
        ("angle > 1 // why", "begins a comment"),
        ("+".join(["angle"] * 300) + " > 1", "256 keys"),
        ("-" * 300 + "angle > 1", "the condition is too long"),
    ],
)
def test_mistakes(text: str, message: str) -> None:
    """Each is refused at its place."""
    with pytest.raises((TreeError, LimitError)) as excinfo:
        read(text)
    assert message in str(excinfo.value)


def test_names() -> None:
    """Constants and parameters are parts of sums; keys are found, and thresholds are not."""
    text = """
        constant half = 0.5
        subtree turn(key, by) = when half * key + spin > by { Go }
        use turn(angle, 2)
    """
    tree = parse(text, WORDS)
    assert to_text(tree) == "when 0.5 * angle + spin > 2 { Go }\n"
    assert keys_in(tree) == ("angle", "spin")
    assert thresholds(parse("when 2 * angle > 3 { Go }", WORDS), "angle") == ()


@pytest.mark.parametrize(
    ("premises", "condition", "follows"),
    [
        (["angle + spin > 2"], "angle + spin > 1", True),
        (["angle > 1", "spin > 1"], "angle + spin >= 2", True),
        (["angle > 1", "spin > 1"], "angle + spin > 2", False),  # the sum may be rounded
        (["angle >= 2", "spin <= 1"], "2 * angle - spin >= 3", True),
        (["angle < 0.9", "spin > 2"], "angle < 0.5 * spin", True),
        (["angle / spin > 2"], "not angle / spin < 1", True),
        (["not angle / spin > 2"], "angle / spin <= 2", False),
    ],
)
def test_what_follows(premises: list[str], condition: str, follows: bool) -> None:
    """Equal sums are one number, and the ranges of its keys bound a sum."""
    known = tuple(parse_condition(each, WORDS) for each in premises)
    assert implies(known, parse_condition(condition, WORDS)) is follows


def test_a_division_by_a_key_has_no_opposite() -> None:
    """0 / 0 is no number: neither `angle / spin > 1` nor `angle / spin <= 1` holds."""
    more, less = read("angle / spin > 1"), read("angle / spin <= 1")
    assert excludes((more,), less)
    tree = parse("selector { when angle / spin > 1 { Go } when angle / spin <= 1 { Go } }", WORDS)
    assert not implies((parse_condition("not angle / spin > 1", WORDS),), less)
    assert keys_in(tree) == ("angle", "spin")


NUMBERS = [0.0, -0.0, 0.1, 1.0, -1.5, 3.0, 1e6]


@examples(max_examples=100, deadline=None)
@given(
    expr=conditions(st.sampled_from(NUMBERS), pairs=True),
    values=st.lists(st.sampled_from(NUMBERS), min_size=40, max_size=40),
)
def test_libraries_agree(expr: ConditionExpr, values: list[float]) -> None:
    """BehaviorTree.CPP and py_trees find the same truth, and a script comes back as it was."""
    cpp: Any = pytest.importorskip("behaviortreepy", reason="extra `btcpp` is not installed")
    library: Any = pytest.importorskip("py_trees", reason="extra `pytrees` is not installed")
    tree = guarded(expr, leaf("PatrolWaypoint"))
    assert read_condition(behaviortree_cpp._script(expr), VOCABULARY) == expr
    places = VOCABULARY.key_index
    names = [*places]
    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree), module)
    library.blackboard.Blackboard.clear()
    root = module["create_tree"](lambda name: library.behaviours.Success(name))
    writer = library.blackboard.Client(name="robot")
    for name in names:
        writer.register_key(name, access=library.common.Access.WRITE)
    factory = cpp.BehaviorTreeFactory()
    code = quoteattr(behaviortree_cpp._script(expr))
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="T"><ScriptCondition code={code}/>'
    board_cpp = cpp.Blackboard.create()
    for name in names:
        _set(board_cpp, name, 0.0)
    ticked = factory.create_tree_from_text(f"{xml}</BehaviorTree></root>", board_cpp)
    equals = any(term.operator in ("==", "!=") for term in terms(expr))
    for start in range(0, len(values) - len(names) + 1, len(names)):
        board = [0.0] * len(places)
        for name, value in zip(names, values[start:], strict=False):
            value = float(value > 0) if VOCABULARY.keys[name].flag else value
            board[places[name]] = value
            writer.set(name, value)
            _set(board_cpp, name, value)
        truth = holds(expr, board, places)
        root.tick_once()
        assert (root.status == library.common.Status.SUCCESS) is truth
        if not equals:  # the library compares with a tolerance
            assert (ticked.tick_exactly_once() == cpp.NodeStatus.SUCCESS) is truth


def _set(board: Any, name: str, value: float) -> None:
    if VOCABULARY.keys[name].flag:
        board.set_bool(name, bool(value))
    else:
        board.set_double(name, value)


def test_bounds_are_exact() -> None:
    """No value of a sum is outside the bounds that the analysis uses, to the last bit."""
    sum_of = read("0.1 * angle + 0.3 * spin - speed > 0")
    assert isinstance(sum_of.key, Formula)
    for values in product((-5.0, 5.0), (-5.0, 5.0), (0.0, 2.0)):
        value = 0.1 * values[0] + 0.3 * values[1] - values[2]
        facts = tuple(
            Condition(key, sign, number)
            for key, number in zip(("angle", "spin", "speed"), values, strict=True)
            for sign in (">=", "<=")
        )
        assert implies(facts, sum_of._replace(operator=">=", number=value))
        assert implies(facts, sum_of._replace(operator="<=", number=value))


def test_mutation_moves_the_numbers_of_sums() -> None:
    """`tune` moves each number of a sum and its threshold; the keys and operations stay."""
    plan = search_and_plan("racing", "domain=cartpole")[1]
    tree = parse(
        "selector { when 0.5 * angle + turning / 2 > 0.1 { PushLeft } PushRight }", plan.vocabulary
    )
    assert places_of_numbers(tree, plan.space) == [(1, 0), (1, 1), (1, 2)]
    rng, texts = np.random.default_rng(0), set()
    for _ in range(50):
        child = tune(
            rng,
            tree,
            plan.space,
            MutationSettings(operators={"tune": 1}, subtree_depth=2, number_sd=0.2),
        )
        assert parse(to_text(child), plan.vocabulary) == child
        text = condition_text(guard_of(child.children[0]).condition)
        assert re.fullmatch(r"\S+ \* angle \+ turning / \S+ > \S+", text)
        texts.add(text)
    assert len(texts) > 40
