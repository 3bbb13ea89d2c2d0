"""Parameters of subtrees: numbers, keys, words, actions and subtrees in their places."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import process_time

import pytest
from hypothesis import given
from hypothesis import strategies as st

import islandgp
from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.condition import Compound, Condition, ConditionExpr
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, parse_placed, to_text, tree_errors
from islandgp.bt.core.node import GuardArgs, Node, leaf, size, walk
from islandgp.bt.core.parameters import one_of, real, text
from islandgp.bt.core.printer import Named
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag, number
from islandgp.bt.export import behaviortree_cpp
from islandgp.bt.export.import_cpp import read_tree
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import LimitError, TreeError
from islandgp_numbers.numbers import numbers_of, with_numbers
from tests.goldens import FOLDER
from tests.profiles import examples
from tests.strategies import nodes

GOAL = one_of("where to", ("dock", "door", "bin"))
MOVE = {
    "goal": GOAL,
    "speed": real("how fast", 0.1, 1.0, default=0.5),
    "topic": text("of ROS"),
}
MODES = ("docking", "driving")
BOT = Vocabulary(
    "bot",
    {"MoveTo": Action("goes", arguments=MOVE), "Charge": Action("charges"), "Grasp": Action("")},
    {
        "near": flag("at the goal"),
        "battery": number("percent", 0, 100),
        "reserve": number("percent", 0, 100),
        "mode": enumeration("now", MODES),
        "last": enumeration("before", MODES),
    },
)
FILE = (FOLDER / "parameters.bt").read_text(encoding="utf-8")
LIBRARY = FILE[: FILE.index("selector {\n  use guarded")]
EXPANDED = """selector {
  when battery < reserve abort lower { Charge }
  sequence {
    when battery < 20 abort lower { retry 2 { timeout 2.5 { MoveTo(goal: bin) } } }
    when reserve < 5 abort lower { MoveTo(goal: bin) }
  }
  when mode == docking { sequence { MoveTo(goal: dock, speed: 0.3) Grasp } }
  when mode == last {
    selector {
      when near { Grasp }
      sequence { MoveTo(goal: bin, speed: 1) Grasp }
    }
  }
}
"""


def test_a_file_of_all_kinds() -> None:
    """Each use is what it would be without the subtree; its nodes have places in the file."""
    tree = parse(FILE, BOT)
    assert tree == parse(EXPANDED, BOT)
    placed = parse_placed(FILE, BOT)
    assert len(placed.places) == size(tree)
    lines = FILE.splitlines()
    for node, place in zip(walk(tree), placed.places, strict=True):
        if node.action:
            assert lines[place.line - 1][place.column - 1 :].startswith(node.action)


def test_fmt_keeps_it() -> None:
    """The golden file is canonical; a messy one becomes it."""
    assert format_text(FILE) == FILE
    messy = FILE.replace("(key, level, work)", "( key ,level,work )").replace("0.3)", "00.30\n)")
    messy = messy.replace("use fetch(dock, ", "use   fetch( dock ,")
    assert format_text(messy) == FILE


@pytest.mark.parametrize(
    ("body", "expanded"),
    [
        ("subtree s(t) = MoveTo(topic: t) use s(\"/a b\")", 'MoveTo(topic: "/a b")'),
        ("subtree s(low) = use guarded(battery, low, Charge) use s(3)", "3"),
        ("subtree s(low) = use guarded(battery, 3, MoveTo(speed: low)) use s(0.2)", "speed: 0.2"),
        ("subtree s(level) = use guarded(level, 7, Charge) use s(reserve)", "reserve < 7"),
        ("subtree s(a, b) = sequence { a b } subtree t(a, b) = use s(b, a) use t(Charge, Grasp)",
         "sequence { Grasp Charge }"),
        ("subtree s(Charge) = sequence { Charge Grasp } use s(MoveTo)", "{ MoveTo Grasp }"),
        ("subtree s(x) = x subtree t(x) = use s(use s(use s(x))) use t(Charge)", "Charge"),
        ("subtree s(x) = Charge use s(use fetch(bin, 1))", "Charge"),
        ("subtree s(n) = parallel success n { Charge Grasp } use s(2)", "success 2"),
    ],
)  # fmt: skip
def test_names_belong_to_their_place(body: str, expanded: str) -> None:
    """A parameter hides a constant or an action; an argument means what it means where it is."""
    assert expanded in to_text(parse(f"{LIBRARY}{body}", BOT))


@pytest.mark.parametrize(
    ("body", "column", "message"),
    [
        ("use guarded(20, 20, Charge)", 13, "unexpected '20' (parameter key of guarded)"),
        ("use guarded(20, 20, Charge)", 13, "Expected a key."),
        ("use guarded(Charge, 20, Charge)", 13, "unknown blackboard key 'Charge' (parameter key"),
        ("use guarded(batery, 20, Charge)", 13, "Did you mean battery?"),
        ("use guarded(near, 20, Charge)", 13, "near is a flag"),
        ("use guarded(mode, 20, Charge)", 13, "does not fit here (parameter key of guarded)"),
        ("use guarded(battery, 20, 20)", 26, "Expected an action or a `use`"),
        ("use guarded(battery, 20, fetch)", 26, "Did you mean use fetch?"),
        ("use guarded(battery, 20, Chrge)", 26, "Did you mean Charge?"),
        ("use guarded(battery, Charge, Grasp)", 22, "'Charge' does not fit battery"),
        ("use guarded(battery, battery, Grasp)", 22, "'battery' does not fit battery"),
        ("use guarded(battery, MoveTo(goal: bin), Grasp)", 22, "a number, a key or a word"),
        ("use guarded(battery, 2, sequence { Grasp })", 34, "a `use` of a subtree"),
        ("use guarded(battery, 2, MoveTo(goal: bn))", 38, "Did you mean bin?"),
        ("use while_in(mode, doking, Grasp)", 20, "Did you mean docking?"),
        ("use while_in(mode, 3, Grasp)", 20, "'3' does not fit mode, which is one of"),
        ("use while_in(mode, battery, Grasp)", 20, "does not fit mode"),
        ("use fetch(doc, 0.3)", 11, "Did you mean dock?"),
        ("use fetch(dock, 3)", 17, "Expected 0.1 to 1"),
        ("use fetch(dock, door)", 17, "unknown constant 'door'"),
        ("use patiently(1.5, Grasp)", 15, "'1.5' as its count (parameter times of patiently)"),
        ("use patiently(battery, Grasp)", 15, "Expected a number"),
        ('use patiently("3", Grasp)', 15, "Expected a number"),
        ("use either(battery, Grasp, Grasp)", 12, "does not fit here (parameter flag of"),
        ("use either(near, Grasp)", 5, "takes 3 arguments, found 2"),
        ("use either(near, use guarded(battery, 1e5, Grasp), Grasp)", 39, "not a plain number"),
        ("subtree s(x) = x(goal: dock) Grasp", 16, "parameter 'x' takes no arguments"),
        ("subtree s(x) = use x Grasp", 20, "Did you mean x, without use?"),
        ("subtree s(work) = sequence { wrk } Grasp", 30, "Did you mean work?"),
        ("subtree s(key) = when kye < 3 { Grasp } Grasp", 23, "Did you mean key?"),
    ],
)  # fmt: skip
def test_a_wrong_argument_is_named_where_it_is_passed(body: str, column: int, message: str) -> None:
    """The message has the argument's place, its parameter, and what fits."""
    with pytest.raises(TreeError) as error:
        parse(f"{LIBRARY}{body}", BOT, name="t.bt")
    assert message in str(error.value)
    assert (error.value.line, error.value.column) == (LIBRARY.count("\n") + 1, column)


def test_all_wrong_arguments_are_reported() -> None:
    """Each at its place."""
    body = "sequence { use fetch(doc, 1) use guarded(batery, 1, Grasp) use fetch(bi, 1) }"
    errors = tree_errors(f"{LIBRARY}{body}", BOT, name="t.bt", folder=None)
    assert [error.column for error in errors] == [22, 42, 70]


def test_unused_parameters_and_constants() -> None:
    """A parameter is used in any place that it can have; what is passed for it is used, too."""
    text = """constant slow = 0.2
    constant spare = 1
    subtree go(place) = MoveTo(goal: place, speed: slow)
    subtree s(key, work, nothing) = when key { work }
    use s(near, use go(bin), Charge)
    """
    places = [(w.code, w.line, w.column) for w in warnings(text, BOT)]
    assert places == [("unused-constant", 2, 14), ("unused-parameter", 4, 26)]


def test_a_guard_that_one_use_needs_is_not_redundant() -> None:
    """A shared subtree is judged by all its uses, with the keys that they pass."""
    shared = "subtree s(key, work) = when key > 5 { work }\n"
    one = f"{shared}when battery > 5 {{ use s(battery, Charge) }}"
    assert [w.code for w in warnings(one, BOT)] == ["needless-guard"]
    uses = "use s(battery, Charge) use s(reserve, Grasp)"
    two = f"{shared}when battery > 5 {{ sequence {{ {uses} }} }}"
    assert warnings(two, BOT) == []


def test_tune_knows_what_numbers_are_compared_with() -> None:
    """By the keys that are passed beside them, or that any use passes."""
    text = """constant least = 10
    subtree g(key, level, work) = when key < level { when key > 1 { work } }
    subtree outer(key, level) = use g(key, level, use g(battery, 7, Charge))
    sequence { use outer(reserve, 11) use g(battery, least, MoveTo(speed: 0.25)) }
    """
    numbers = numbers_of(text, BOT)
    assert [(each.value, {*each.purposes}) for each in numbers] == [
        (10.0, {"battery"}),
        (1.0, {"battery", "reserve"}),
        (7.0, {"battery"}),
        (11.0, {"reserve"}),
        (0.25, {"MoveTo.speed"}),
    ]
    assert with_numbers(text, numbers, [each.value for each in numbers]) == text


def test_subtrees_of_an_export_are_those_of_the_arguments() -> None:
    """A SubTree for each set of arguments, with a name of theirs; reading it gives them back."""
    xml = behaviortree_cpp.to_xml(parse(FILE, BOT, marked=True), BOT)
    assert '<BehaviorTree ID="guarded_battery_reserve_Charge">' in xml
    assert '<BehaviorTree ID="fetch_dock_0_3">' in xml
    imported = parse(read_tree(xml, BOT).text, BOT, marked=True)
    assert behaviortree_cpp.to_xml(imported, BOT) == xml


@st.composite
def lifted(draw: st.DrawFn) -> tuple[Node, str]:
    """A tree, and a text in which some of its keys, numbers and branches are arguments."""
    tree = draw(nodes(pairs=True))
    arguments: list[str] = []
    definitions: list[str] = []

    def parameter(argument: str) -> str:
        arguments.append(argument)
        return f"p{len(arguments)}"

    def condition(expr: ConditionExpr) -> ConditionExpr:
        if isinstance(expr, Compound):
            return Compound(expr.word, tuple(map(condition, expr.parts)))
        key, other, value = expr.key, expr.other, expr.number
        if key in VOCABULARY.keys and draw(st.booleans()):  # a negated key is no argument
            key = parameter(key)
        if expr.operator not in ("is", "not") and draw(st.booleans()):
            name = parameter(
                other or to_text(Node("when", GuardArgs(expr), (leaf("x"),))).split()[3]
            )
            return Condition(key, expr.operator, Named(name, value), name if other else "")
        return Condition(key, expr.operator, value, other)

    def branch(node: Node) -> Node:
        if draw(st.integers(0, 4)) == 0:
            if node.action:
                return leaf(parameter(node.action))
            definitions.append(f"subtree s{len(definitions)} = {to_text(node)}")
            return leaf(parameter(f"use s{len(definitions) - 1}"))
        args = node.args
        if isinstance(args, GuardArgs):
            args = GuardArgs(condition(args.condition), args.abort)
        return Node(node.kind, args, tuple(map(branch, node.children)))

    body = to_text(branch(tree))
    names = ", ".join(f"p{i}" for i in range(1, len(arguments) + 1))
    heading = f"subtree whole({names})" if arguments else "subtree whole"
    use = f"use whole({', '.join(arguments)})" if arguments else "use whole"
    return tree, "".join([*definitions, f"{heading} = {body}", use, "\n"])


@examples(150)
@given(lifted())
def test_a_use_equals_writing_it_out(case: tuple[Node, str]) -> None:
    """With or without a vocabulary, and `fmt` changes nothing of it."""
    tree, text = case
    assert parse(text, VOCABULARY) == tree
    assert to_text(parse(text)) == to_text(tree)
    tidy = format_text(text)
    assert format_text(tidy) == tidy
    assert parse(tidy, VOCABULARY) == tree
    marked = parse(text, VOCABULARY, marked=True)
    assert marked == tree


def chain(body: Callable[[int], str], last: str) -> str:
    """Ninety subtrees, each of which uses the one before."""
    return " ".join([f"subtree s{i}(x) = {body(i - 1)}" for i in range(1, 90)] + [last])


DOUBLED = "subtree i(x) = x subtree two(x) = sequence { x x } " + " ".join(
    f"subtree d{i}(x) = use {f'd{i - 1}' if i else 'two'}(use two(x))" for i in range(12)
)
HOSTILE = {
    "nested": f"subtree i(x) = x use {'i(use ' * 9000}i(SeekCharger){')' * 9000}",
    "doubling arguments": chain(
        lambda i: f"use s{i}(use s{i}(x))", "use s89(SeekCharger)"
    ).replace("subtree s1", "subtree s0(x) = x subtree s1", 1),
    "doubling trees": chain(
        lambda i: f"use s{i}(use s{i}(x))", "use s89(SeekCharger)"
    ).replace("subtree s1", "subtree s0(x) = sequence { x x } subtree s1", 1),
    "many": f"{DOUBLED} sequence {{{' use i(use i(SeekCharger))' * 3000} }}",
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_arguments(name: str) -> None:
    """They are refused early, in each mode of parsing."""
    begin = process_time()
    with pytest.raises(LimitError, match="at most"):
        parse(HOSTILE[name], VOCABULARY)
    with pytest.raises(LimitError, match="at most"):
        parse(HOSTILE[name], marked=True)
    tree_errors(HOSTILE[name], VOCABULARY, name="t.bt", folder=None)
    assert process_time() - begin < 3


def test_the_deepest_arguments() -> None:
    """Ninety uses in each other below ninety levels are within the limits."""
    nested = f"{'i(use ' * 89}i(SeekCharger){')' * 89}"
    text = f"subtree i(x) = x {'inverter { ' * 90}use {nested}{' }' * 90}"
    assert size(parse(text, VOCABULARY)) == 91
    assert format_text(text).count("use") == 90


def test_a_program_binds_what_is_passed(tmp_path: Path) -> None:
    """Functions get the arguments of the actions that a tree passes to its subtrees."""
    file = tmp_path / "robot.bt"
    file.write_text(FILE, encoding="utf-8")
    tree = islandgp.load_tree(file, BOT)
    assert tree.actions() == ("Charge", "MoveTo", "Grasp")
    calls: list[dict[str, object]] = []

    def move(**arguments: object) -> int:
        calls.append(arguments)
        return islandgp.NodeStatus.RUNNING

    board = {"battery": 1, "reserve": 0, "near": False, "mode": "driving", "last": "docking"}
    robot_tree = tree.bind(
        {"Charge": lambda: False, "MoveTo": move, "Grasp": move}, board, step_s=1
    )
    assert robot_tree.tick() is islandgp.NodeStatus.RUNNING
    assert calls == [{"goal": "bin", "speed": 0.5, "topic": ""}]


def test_parameters_of_included_subtrees(tmp_path: Path) -> None:
    """What is passed has its place in the including file, and errors too."""
    (tmp_path / "lib.bt").write_text(LIBRARY, encoding="utf-8")
    template = 'include "lib.bt"\nuse guarded(battery, low, use fetch(dock, {}))\n'
    tree = parse(template.format("0.3"), BOT, folder=tmp_path)
    assert tree == parse(f"{LIBRARY}{template.format('0.3').splitlines()[1]}", BOT)
    with pytest.raises(TreeError, match=r"t\.bt:2:43: '3' is not a value of speed"):
        parse(template.format("3"), BOT, name="t.bt", folder=tmp_path)
