"""Keys that are one of some words, and comparisons of two keys."""

from __future__ import annotations

import pickle
from enum import StrEnum
from pathlib import Path

import numpy as np
import pytest

import islandgp
from islandgp.bt.analysis.lint import warnings
from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, parse_condition, to_text
from islandgp.bt.core.node import Limits, Node, asked_in, guarded, keys_in, leaf
from islandgp.bt.core.parameters import adapter
from islandgp.bt.core.vocabulary import (
    Action,
    Condition,
    Key,
    Vocabulary,
    enumeration,
    flag,
    integer,
    number,
)
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.bt.export.py_trees import to_python
from islandgp.errors import DomainError, TreeError
from islandgp.gp.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.gp.variation import MUTATIONS, MutationSettings, mutate

MODES = ("idle", "docking", "driving")
KEYS = {
    "mode": enumeration("what it does", MODES),
    "before": enumeration("what it did", MODES),
    "gear": enumeration("the only one", ["slow"]),
    "charge": number("%", 0, 100),
    "reserve": number("% that it needs home", 0, 50),
    "items": integer("in the hold", 0, 9, most=9),
    "near": flag("at the dock"),
}
BOT = Vocabulary("bot", {name: Action(name) for name in ("Dock", "Drive", "Stop")}, KEYS)
TREE = (
    "selector { when mode == docking and charge < reserve { Dock } when mode != before { Drive } }"
)


def read(text: str) -> Node:
    return parse(text, BOT)


@pytest.mark.parametrize(
    ("condition", "column", "message"),
    [
        ("mode == dockin", 14, "'dockin' does not fit mode"),
        ("mode == dockin", 14, "Did you mean docking?"),
        ("mode == 1", 14, "idle | docking | driving | before"),
        ("mode < docking", 6, "docking, driving and does not fit here"),
        ("mode", 6, "`when mode == idle`"),
        ("gear == fast", 14, "Expected slow."),
        ("mode == gear", 14, "'gear' does not fit mode"),
        ("mode == items", 14, "'items' does not fit mode"),
        ("items == mode", 15, "'mode' does not fit items, which is a number"),
        ("charge < near", 15, "'near' does not fit charge"),
        ("charge < charge", 15, "'charge' does not fit charge"),
        ("charge < reserv", 15, "Did you mean reserve?"),
        ("charge < docking", 15, "'docking' does not fit charge"),
        ("mode == größe", 16, "U+00F6"),
        ("mode == both", 14, "'both' does not fit mode"),
    ],
)
def test_wrong_comparisons(condition: str, column: int, message: str) -> None:
    """Each mistake has its place, the values that are right there, and the nearest of them."""
    with pytest.raises(TreeError) as error:
        read(f"when {condition} {{ Dock }}")
    assert message in str(error.value)
    assert error.value.column == column


@pytest.mark.parametrize(
    ("key", "message"),
    [
        (enumeration("", ["not"]), "names, or lines of text without double quotes as words.0"),
        (enumeration("", ['a "b"']), "lines of text without double quotes as words.0"),
        (enumeration("", ["a", "a"]), "different words"),
        (enumeration("", ["charge"]), "each name once in the domain bot, found 'charge'"),
        (Key("", words=("a",)), "enumeration(...)"),
    ],
)
def test_wrong_words(key: Key, message: str) -> None:
    """A domain's author learns which key has words that no tree can contain."""
    with pytest.raises(DomainError, match="the domain bot") as error:
        Vocabulary("bot", {}, {"k": key, "charge": number("%", 0, 1)})
    assert message in str(error.value)


def test_texts_and_files_keep_them() -> None:
    """The text, JSON, XML and a pickle bring the same tree back; `fmt` needs no vocabulary."""
    tree = read(TREE)
    assert keys_in(tree) == ("mode", "charge", "reserve", "before")
    assert to_text(read(to_text(tree))) == to_text(tree) == format_text(TREE)
    assert to_text(parse(TREE)) == to_text(tree)
    xml = to_xml(tree, BOT)
    assert "mode == 'docking'" in xml
    assert to_text(read_tree(xml, BOT, name="t.xml").tree) == to_text(tree)
    assert to_text(pickle.loads(pickle.dumps(tree))) == to_text(tree)


def test_a_constant_hides_a_key() -> None:
    """A constant is nearer than a key of its name; a word of the key is nearer than both."""
    tree = read(
        "constant reserve = 7 constant idle = 1 when charge < reserve and mode == idle { Dock }"
    )
    assert [term.other for term in asked_in(tree)] == ["", ""]
    assert to_text(tree) == "when charge < 7 and mode == idle { Dock }\n"


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("when mode == idle { when mode == docking { Dock } }", "unreachable"),
        ("when mode == idle { when mode != docking { Dock } }", "needless-guard"),
        ("when gear == slow { Dock }", "needless-guard"),
        ("when charge < reserve { when reserve <= charge { Dock } }", "unreachable"),
        ("when charge < reserve { when charge <= reserve { Dock } }", "needless-guard"),
        ("when charge < reserve and charge < reserve { Dock }", "long-condition"),
        ("when charge < reserve { when charge < 20 { Dock } }", ""),
        ("when mode == before { when mode == idle { Dock } }", ""),
    ],
)
def test_check_and_simplify(text: str, code: str) -> None:
    """A word excludes the others; of two keys, their difference is followed and nothing else."""
    assert [each.code for each in warnings(text, BOT)] == [code] * bool(code)
    assert (simplify(read(text), BOT).tree == read(text)) == (code in ("", "unreachable"))


def test_evolution_draws_and_moves_them() -> None:
    """Each random and mutated tree can be read; words are compared, two keys are not."""
    rng = np.random.default_rng(3)
    weights = {"depth": (2, 3), "leaf": 0.2, "children": (2, 3), "repeats": 3}
    choices = {"kinds": {"selector": 1, "when": 2}, "operators": {"<": 1}, "aborts": {"both": 1}}
    terms = set()
    space = TreeSpace(TreeSettings.model_validate({**weights, **choices}), BOT, Limits(8, 50))
    for _ in range(60):
        operator = {str(rng.choice([*MUTATIONS])): 1.0}
        mutation = MutationSettings(operators=operator, subtree_depth=2, number_sd=0.5)
        tree, _ = mutate(rng, random_tree(rng, space), rate=1.0, space=space, settings=mutation)
        assert to_text(read(to_text(tree))) == to_text(tree)
        terms |= {(term.key, bool(term.other)) for term in asked_in(tree)}
    assert ("mode", False) in terms
    assert not any(other for _, other in terms)


class Mode(StrEnum):
    """Modes of a program."""

    DOCKING = "docking"


def test_a_program_gives_words(tmp_path: Path) -> None:
    """`bind` takes a word, a member of a StrEnum or an index, and refuses anything else."""
    file = tmp_path / "t.bt"
    file.write_text(TREE)
    values: dict[str, object] = {"mode": Mode.DOCKING, "before": 0, "charge": 5, "reserve": 9}
    leaves = {"Dock": lambda: True, "Drive": lambda: False}
    robot = islandgp.load_tree(file, BOT).bind(leaves, {k: lambda k=k: values[k] for k in values})
    assert robot.tick() == 1
    values["reserve"] = 5
    assert robot.tick() == 0
    for word in ("parked", 3, 0.5, None):
        values["mode"] = word
        with pytest.raises(DomainError, match="one of idle, docking, driving as the value of"):
            robot.tick()


def test_conditions_of_actions() -> None:
    """An action can need a word or a comparison of keys, also in a vocabulary file."""
    needs = (
        Condition("mode", "==", KEYS["mode"].number_of("docking")),
        Condition("charge", "<", 0, "reserve"),
    )
    vocabulary = Vocabulary("bot", {"Dock": Action("", to_start=needs)}, KEYS)
    text = "when mode == idle { Dock }"
    assert "it needs mode == docking" in str(warnings(text, vocabulary)[0])
    copy = declared(adapter(Vocabulary).dump_json(vocabulary).decode(), text, name="bot.json")
    assert copy == vocabulary
    with pytest.raises(DomainError, match="a list of words"):
        declared('{"domain": "b", "actions": {}, "keys": {"k": {"words": []}}}', "", name="b.json")
    assert to_text(guarded(copy.actions["Dock"].to_start[0], leaf("Dock"))) == (
        "when mode == docking { Dock }\n"
    )
    assert parse_condition("mode == docking and charge < reserve", vocabulary).parts == needs  # type: ignore[union-attr]


def test_texts_as_words_of_a_key() -> None:
    """A word that is no name is in double quotes, in each form of a tree."""
    words = ("given", "not given", "45 deg/", "")
    robot = Vocabulary(
        "bot", {"Stop": Action("")}, {"reply": enumeration("", words, initial="not given")}
    )
    text = (
        'selector {\n  when reply == "not given" or reply != "" {\n'
        '    sequence { set reply = "45 deg/" set reply = given Stop }\n  }\n  Stop\n}\n'
    )
    tree = parse(text, robot)
    assert to_text(tree) == text == to_text(parse(text))
    assert parse(format_text(text), robot) == tree
    assert read_tree(to_xml(tree, robot), robot).tree == tree
    assert "'45 deg/'" in to_python(tree, robot)
    with pytest.raises(TreeError, match="does not fit reply"):
        parse('set reply = "other"', robot)
