"""Arguments of actions: how they are declared, written, read, drawn and moved."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import SUCCESS, ActionArgs, Limits, Node, walk
from islandgp.bt.core.parameters import bound, fits, one_of, real, switch, whole
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag, number
from islandgp.errors import DomainError, TreeError
from islandgp.gp.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.gp.variation import MUTATIONS, MutationSettings, mutate
from islandgp_numbers.numbers import numbers_of, with_numbers
from tests.profiles import examples

ARGUMENTS = {
    "goal": one_of("where to", ("dock", "door", "bin")),
    "speed": real("how fast", 0.1, 1.0, default=0.5, unit="m/s"),
    "gain": real("of the controller", 0.001, 100, logarithmic=True),
    "tries": whole("how often", 1, 5),
    "loud": switch("with the horn"),
}
BOT = Vocabulary(
    "bot",
    {"MoveTo": Action("goes there", arguments=ARGUMENTS), "Stop": Action("stops")},
    {"near": flag("at the goal"), "range": number("m", 0, 5)},
)
SPACE = TreeSpace(
    TreeSettings(
        depth=(2, 3),
        leaf=0.3,
        children=(2, 3),
        repeats=3,
        kinds={"selector": 1, "sequence": 1, "when": 1},
        operators={"<": 1, ">": 1},
        aborts={"both": 1},
    ),
    BOT,
    Limits(8, 50),
)


def read(text: str) -> Node:
    return parse(text, BOT)


def test_written_in_the_declared_order_without_defaults() -> None:
    """Trees that mean the same are equal and have one text."""
    tree = read("MoveTo(speed: 0.8, tries: 1, goal: door)")
    assert to_text(tree) == "MoveTo(goal: door, speed: 0.8)\n"
    assert tree == read("MoveTo(goal: door, speed: 0.8)")
    assert read("MoveTo(speed: 0.5)") == read("MoveTo")


def test_constants_and_parameters_are_values() -> None:
    """A number may be a constant or a parameter  of a subtree, for any range."""
    text = """
    constant slow = 0.2
    subtree go(v) = MoveTo(speed: v)
    sequence { use go(0.8) use go(slow) MoveTo(speed: slow, loud: yes) }
    """
    leaves = [to_text(node) for node in walk(read(text)) if node.action]
    assert leaves == [
        "MoveTo(speed: 0.8)\n",
        "MoveTo(speed: 0.2)\n",
        "MoveTo(speed: 0.2, loud: yes)\n",
    ]
    with pytest.raises(TreeError, match="'3' is not a value of speed"):
        read("subtree go(v) = MoveTo(speed: v) use go(3)")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("MoveTo(goal: dor)", "Expected dock | door | bin.\nDid you mean door"),
        ("MoveTo(sped: 1)", "Did you mean speed"),
        ("MoveTo(speed: 3)", "Expected 0.1 to 1 m/s"),
        ("MoveTo(speed: fast)", "unknown constant 'fast'"),
        ("MoveTo(tries: 1.5)", "a whole number from 1 to 5"),
        ("MoveTo(tries: 1, tries: 2)", "each argument once"),
        ("MoveTo(loud: maybe)", "no | yes"),
        ("Stop(speed: 1)", "unknown argument 'speed' of Stop"),
        ("MoveTo(goal dock)", "Expected :"),
        ("sequence { MoveTo(goal: door) Fly }", "unknown action 'Fly'"),
    ],
)
def test_wrong_arguments(text: str, message: str) -> None:
    """Each mistake is reported with its place and what is valid there."""
    with pytest.raises(TreeError) as error:
        read(text)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        (real("", 1, 1), "low < high"),
        (real("", 0, 1, logarithmic=True), "above 0"),
        (real("", 0, 1, default=2), "default"),
        (real("", 0, 1, step=0), "a step from 1e-09 to high - low"),
        (real("", 0, 1, step=-1), "a step from 1e-09 to high - low"),
        (real("", 0, 1, step=5), "a step from 1e-09 to high - low"),
        (real("", 0, 1, step=nan), "a finite number as step"),
        (real("", 0, inf), "a finite number"),
        (real("", nan, 1), "a finite number"),
        (real("", "0", 1), "a finite number as low"),
        (real("", 0, 10**400), "a finite number as high"),
        (real("", 0, 1, unit=3), "a valid string as unit"),
        (whole("", 0, 2**53), "to 1,000,000"),
        (whole("", 0, 3, default=inf), "a finite number as default"),
        (switch("", default=1), "a default of no | yes"),
        (one_of("", (1, 2)), "a valid string as words.0"),
        (one_of("", ("a-b",)), "letters, digits and _"),
        (one_of("", ("a", "a")), "at least one word, each once"),
        (3, "an instance of Parameter"),
    ],
)
def test_wrong_declarations(argument: Any, message: str) -> None:
    """A domain's author reads what is wrong, and of which argument."""
    actions = {"Go": Action("goes", arguments={"v": argument})}
    with pytest.raises(DomainError, match="argument v of the action Go") as error:
        Vocabulary("bot", actions, {})
    assert message in str(error.value)


@examples(100)
@given(st.integers(0, 10**6), st.sampled_from([*MUTATIONS]))
def test_random_trees_keep_their_ranges(seed: int, operator: str) -> None:
    """What evolution draws and moves can be written, read and sent as JSON."""
    rng = np.random.default_rng(seed)
    settings = MutationSettings(operators={operator: 1}, subtree_depth=2, number_sd=0.5)
    tree, _ = mutate(rng, random_tree(rng, SPACE), rate=1.0, space=SPACE, settings=settings)
    assert read(to_text(tree)) == tree == parse(to_text(tree))
    for node in walk(tree):
        if isinstance(node.args, ActionArgs):
            assert all(fits(ARGUMENTS[key], value) for key, value in node.args.values)


def test_numbers_leave_any_grid_and_spread_by_their_logarithm() -> None:
    """A third of the values of a logarithmic argument lies in each third of its decades."""
    rng = np.random.default_rng(1)
    values_of: dict[str, list[float]] = {"speed": [], "gain": []}
    for _ in range(1000):
        for node in walk(random_tree(rng, SPACE)):
            if isinstance(node.args, ActionArgs):
                for key, value in node.args.values:
                    if key in values_of:
                        values_of[key].append(float(value))
    assert len(set(values_of["speed"])) > 300
    low = sum(value < 0.0464 for value in values_of["gain"]) / len(values_of["gain"])
    assert 0.25 < low < 0.42


def test_leaves_get_their_arguments() -> None:
    """The engine asks for one tick a leaf; flags become True or False, whole numbers int."""
    arguments: list[dict[str, object]] = []

    def tick_of(args: ActionArgs) -> object:
        arguments.append(dict(bound(args, ARGUMENTS)))
        return lambda _fresh: SUCCESS

    tree = read("sequence { MoveTo(speed: 0.7, loud: yes, tries: 2) MoveTo }")
    assert compile_tree(tree, tick_of, [0.0, 0.0], BOT.key_index)() == SUCCESS  # type: ignore[arg-type]
    assert arguments[0]["speed"] == 0.7
    assert arguments[0]["loud"] is True
    assert type(arguments[0]["tries"]) is int
    assert arguments[1]["goal"] == "dock"


def test_format_and_tune_know_arguments() -> None:
    """`fmt` keeps comments and names; `tune` finds the numbers, with what they are for."""
    text = "constant v = 0.75\nsequence{MoveTo(speed:v, # fast\n loud:yes)Stop}"
    assert format_text(text) == (
        "constant v = 0.75\n\nsequence {\n  # fast\n  MoveTo(speed: v, loud: yes)\n  Stop\n}\n"
    )
    numbers = numbers_of(text, BOT)
    assert [(each.value, each.purposes) for each in numbers] == [(0.75, {"MoveTo.speed"})]
    assert with_numbers(text, numbers, [0.25]).startswith("constant v = 0.25\n")


STEPS = {
    "coarse": real("", 0.5, 4.0, step=0.25),
    "fine": real("", 0, 100, step=0.125),
    "uneven": real("", 0, 1, step=0.3),
    "scale": real("", 0.5, 8, step=0.5, logarithmic=True),
}


@pytest.mark.parametrize("operator", ["parameter", "tune", "subtree"])
@pytest.mark.parametrize("name", STEPS)
def test_evolved_arguments_keep_their_steps(name: str, operator: str) -> None:
    """Random and changed numbers are the least one and a multiple of the step."""
    vocabulary = Vocabulary("arm", {"Turn": Action("", arguments={name: STEPS[name]})}, {})
    space = TreeSpace(SPACE.settings, vocabulary, SPACE.limits)
    settings = MutationSettings(operators={operator: 1}, subtree_depth=2, number_sd=0.2)
    rng = np.random.default_rng(0)
    tree = random_tree(rng, space)
    values: set[float] = set()
    for _ in range(60):
        tree = mutate(rng, tree, rate=1, space=space, settings=settings)[0]
        leaves = [node.args for node in walk(tree) if isinstance(node.args, ActionArgs)]
        values |= {float(value) for args in leaves for _, value in args.values}
    parameter = STEPS[name]
    assert parameter.step is not None
    steps = {(value - parameter.low) / parameter.step for value in values}
    assert len(steps) > 2
    assert all(abs(each - round(each)) < 1e-6 for each in steps)
