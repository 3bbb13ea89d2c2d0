"""Errors of the language for a text that is not a tree."""

from __future__ import annotations

import pickle

import pytest

from islandgp.bt.core.language import parse
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import LimitError, TreeError, UnknownNameError

P = "PatrolWaypoint"

# text, line, column, words that the message has
WRONG = [
    # the form
    ("", 1, 1, ["the text is empty", "a node or an action"]),
    ("# nothing\n", 1, 1, ["the text is empty"]),
    ("selector {", 1, 11, ["too early", "a node or an action"]),
    ("selector {\n  PatrolWaypoint\n\n", 2, 17, ["too early", "}"]),
    ("selector { PatrolWaypoint # }\n", 1, 26, ["too early"]),
    ("selector PatrolWaypoint", 1, 10, [f"'{P}'", "Expected {"]),
    ("selector { PatrolWaypoint }}", 1, 28, ["one tree"]),
    ("PatrolWaypoint PatrolWaypoint", 1, 16, ["one tree", "the end"]),
    ("PatrolWaypoint subtree a = PatrolWaypoint", 1, 16, ["after its subtrees"]),
    (
        "inverter { PatrolWaypoint PatrolWaypoint }",
        1,
        27,
        ["no more children", "Expected ( | }"],
    ),
    ("selector [ PatrolWaypoint ]", 1, 10, ["unexpected '['", "Did you mean {?"]),
    ("selector ( PatrolWaypoint )", 1, 10, ["'('", "Expected {"]),
    ("when foundGarbage and { PatrolWaypoint }", 1, 23, ["a key: batteryLevel", "not or ("]),
    ("when (foundGarbage { PatrolWaypoint }", 1, 20, ["'{'", "Expected"]),
    ("when foundGarbage and founGarbage { PatrolWaypoint }", 1, 23, ["Did you mean foundGarbage?"]),
    ("when foundGarbage or (lap) { PatrolWaypoint }", 1, 23, ["is a number"]),
    ("selector { PatrolWaypoint, PickupGarbage }", 1, 26, ["unexpected ','"]),
    ("selector { caf\u00e9 }", 1, 15, ["U+00E9"]),
    ("parallel failure one success all { PatrolWaypoint }", 1, 22, ["'success'", "Expected {"]),
    ("parallel success two { PatrolWaypoint }", 1, 18, ["unknown constant 'two'"]),
    ("parallel succes one { PatrolWaypoint }", 1, 10, ["'succes'", "Did you mean success?"]),
    # names
    ("selector { MoveToGarbag }", 1, 12, ["unknown action", "Did you mean MoveToGarbage?"]),
    ("selector {\n\tmovetogarbage }", 2, 2, ["Did you mean MoveToGarbage?"]),
    ("slector { PatrolWaypoint }", 1, 1, ["unknown node 'slector'", "Did you mean selector?"]),
    ("selector { whn foundGarbage { X } }", 1, 12, ["'whn'", "Did you mean when?"]),
    ("sequence { Patrol { } }", 1, 12, ["unknown node", "Did you mean PatrolWaypoint?"]),
    ("selector { foundGarbage }", 1, 12, ["Did you mean when foundGarbage { ... }?"]),
    ("selector { batteryLevel }", 1, 12, ["Did you mean when batteryLevel < 5 { ... }?"]),
    ("Xyzzy", 1, 1, ["unknown action 'Xyzzy'"]),
    # conditions
    ("when batery < 5 { PatrolWaypoint }", 1, 6, ["blackboard key", "Did you mean batteryLevel?"]),
    ("when not founGarbage { PatrolWaypoint }", 1, 10, ["Did you mean foundGarbage?"]),
    ("when batteryLevel { PatrolWaypoint }", 1, 6, ["is a number", "when batteryLevel < 5", ">="]),
    ("when not lap { PatrolWaypoint }", 1, 10, ["is a number"]),
    (
        "when foundGarbage > 1 { PatrolWaypoint }",
        1,
        6,
        ["Expected `when foundGarbage`"],
    ),
    ("when not { PatrolWaypoint }", 1, 10, ["a key", "isHumanoidWantToClear"]),
    ("when { PatrolWaypoint }", 1, 6, ["a key", "batteryLevel"]),
    ("when batteryLevel = 5 { PatrolWaypoint }", 1, 19, ["'='", "Did you mean ==?"]),
    ("when batteryLevel =< 5 { PatrolWaypoint }", 1, 19, ["'='", "<="]),
    ("when batteryLevel < { PatrolWaypoint }", 1, 21, ["a number"]),
    ("when batteryLevel < nan { PatrolWaypoint }", 1, 21, ["a number"]),
    (
        "when batteryLevel < 25% { PatrolWaypoint }",
        1,
        23,
        ["a number without a unit"],
    ),
    ("when batteryLevel < 1e5 { PatrolWaypoint }", 1, 21, ["'1e5'", "plain number"]),
    ("when batteryLevel < 5. { PatrolWaypoint }", 1, 21, ["'5.'", "plain number"]),
    ("when batteryLevel < 0x1F { PatrolWaypoint }", 1, 21, ["'0x1F'", "plain number"]),
    ("when batteryLevel < 1000001 { PatrolWaypoint }", 1, 21, ["out of range", "1000000"]),
    ("when lap < 5 abort sel { PatrolWaypoint }", 1, 20, ["'sel'", "Did you mean self?"]),
    ("when lap < 5 abort { PatrolWaypoint }", 1, 20, ["both", "lower", "none", "self"]),
    ("when lap < 5 abrt self { PatrolWaypoint }", 1, 14, ["Did you mean abort?"]),
    ("constant a = 3", 1, 15, ["too early", "a node or an action"]),
    ("domain island", 1, 14, ["too early", "a node or an action"]),
    # children
    ("selector { }", 1, 12, ["unexpected '}'"]),
    ("inverter { }", 1, 12, ["unexpected '}'"]),
    (f"recovery 2 {{ {P} }}", 1, 29, ["unexpected '}'"]),
    # flags
    (
        f"when foundGarbage == isHumanoidWantToClear {{ {P} }}",
        1,
        6,
        ["is a flag and does not fit here\n"],
    ),
    (f"when foundGarbage > 0 {{ {P} }}", 1, 6, ["is a flag and does not fit"]),
    # repeaters
    ("repeater { PatrolWaypoint }", 1, 10, ["a number"]),
    ("repeater 0 { PatrolWaypoint }", 1, 10, ["'0' as its count", "1 to 1,000,000"]),
    ("repeater 1000001 { PatrolWaypoint }", 1, 10, ["-1000000 to 1000000"]),
    ("repeater 2.5 { PatrolWaypoint }", 1, 10, ["whole number"]),
    ("repeater -1 { PatrolWaypoint }", 1, 10, ["whole number"]),
    # subtrees
    ("use a", 1, 5, ["unknown subtree 'a'", "none so far"]),
    ("use PatrolWaypoint", 1, 5, ["unknown subtree", "PatrolWaypoint, without use"]),
    (f"subtree charge = {P}\nuse chrge", 2, 5, ["above: charge", "Did you mean charge?"]),
    (f"subtree charge = {P}\nselector {{ charge }}", 2, 12, ["Did you mean use charge?"]),
    ("subtree a = use a use a", 1, 17, ["unknown subtree 'a'", "defined above: none so far"]),
    (f"subtree a = use b\nsubtree b = {P}\nuse a", 1, 17, ["unknown subtree 'b'", "defined above"]),
    (f"subtree a = {P}\nsubtree a = {P}\nuse a", 2, 9, ["defined twice"]),
    (
        "subtree a = inverter { PatrolPoint } PatrolWaypoint",
        1,
        24,
        ["Did you mean PatrolWaypoint?"],
    ),
    (f"subtree a {P} use a", 1, 11, ["= | ("]),
    (f"subtree 1 = {P} use a", 1, 9, ["'1'", "a name"]),
    (f"subtree a = {P}", 1, 27, ["too early", "a node or an action"]),
    ("use", 1, 4, ["too early", "a name"]),
]


@pytest.mark.parametrize(("text", "line", "column", "phrases"), WRONG, ids=[w[0] for w in WRONG])
def test_wrong_text(text: str, line: int, column: int, phrases: list[str]) -> None:
    """Each mistake is reported at its place, with what is valid there."""
    with pytest.raises(TreeError) as excinfo:
        parse(text, VOCABULARY, name="my.bt")
    message = str(excinfo.value)
    assert (excinfo.value.line, excinfo.value.column) == (line, column)
    assert message.startswith(f"my.bt:{line}:{column}: ")
    for phrase in phrases:
        assert phrase in message


def test_whole_message() -> None:
    """A message has the place, the line with a caret, what is valid, and a guess."""
    with pytest.raises(UnknownNameError) as excinfo:
        parse(
            "selector {\n  when batery < 25 { PatrolWaypoint }\n}", VOCABULARY, name="trees/mine.bt"
        )
    assert str(excinfo.value) == (
        "trees/mine.bt:2:8: unknown blackboard key 'batery'\n"
        "      when batery < 25 { PatrolWaypoint }\n"
        "           ^\n"
        "Expected a blackboard key: batteryLevel, robotCurrentExtraCapacity, lap, foundGarbage,"
        " isHumanoidWantToClear.\n"
        "Did you mean batteryLevel?"
    )
    assert excinfo.value.source == "  when batery < 25 { PatrolWaypoint }"


def test_long_line() -> None:
    """Of a very long line the message shows the part around the caret."""
    with pytest.raises(TreeError) as excinfo:
        parse("selector { " + "PatrolWaypoint " * 100 + "Patrl }", VOCABULARY)
    excerpt, caret = str(excinfo.value).splitlines()[1:3]
    assert len(excerpt) < 110
    assert excerpt[caret.index("^") :].startswith("Patrl")


def test_kinds_of_errors() -> None:
    """Names that don't exist and trees that are too large have their own error classes."""
    with pytest.raises(UnknownNameError):
        parse("use nothing", VOCABULARY)
    with pytest.raises(LimitError):
        parse("inverter { " * 200 + "PatrolWaypoint" + " }" * 200, VOCABULARY)
    with pytest.raises(TreeError) as excinfo:
        parse("selector", VOCABULARY)
    assert type(excinfo.value) is TreeError


def test_an_error_from_another_process_keeps_its_place() -> None:
    """An error that crosses a process boundary keeps its place and its message."""
    with pytest.raises(TreeError) as excinfo:
        parse("selector {\n  Patrl }", VOCABULARY)
    copy = pickle.loads(pickle.dumps(excinfo.value))
    assert (str(copy), copy.line, copy.column) == (str(excinfo.value), 2, 3)
