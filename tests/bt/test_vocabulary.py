"""Vocabularies: which are refused, and how the language uses one."""

from __future__ import annotations

import pickle
from dataclasses import replace
from math import inf, nan
from typing import Any

import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, leaf
from islandgp.bt.core.parameters import one_of
from islandgp.bt.core.vocabulary import (
    EMPTY_VOCABULARY,
    RESERVED,
    UNKNOWN,
    Action,
    Condition,
    Key,
    Vocabulary,
    enumeration,
    flag,
    integer,
    number,
)
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError, UnknownNameError
from islandgp.gp.branches import fine

MAZE = Vocabulary(
    domain="maze",
    actions={"Step": Action("goes a step"), "Turn": Action("turns left")},
    keys={"wall": flag("a wall is ahead"), "steps": number("steps gone", 0, 20, step=2, most=99)},
)


@pytest.mark.parametrize("word", sorted(RESERVED))
@pytest.mark.parametrize("role", ["domain", "action", "key"])
def test_words_of_the_language_are_refused(word: str, role: str) -> None:
    """A domain, an action or a key cannot have a keyword as its name."""
    with pytest.raises(DomainError, match=f"found '{word}'.*rename it"):
        Vocabulary(
            word if role == "domain" else "maze",
            {word: Action("")} if role == "action" else {},
            {word: flag("")} if role == "key" else {},
        )


@pytest.mark.parametrize("name", ["", "go home", "2nd", "go-home", "größe", "a.b", "Step\n"])
def test_names_are_letters_digits_and_underscores(name: str) -> None:
    """A name that the lexer would not read as one word is refused."""
    with pytest.raises(DomainError, match="letters, digits and _"):
        Vocabulary("maze", {name: Action("")}, {})


def test_a_name_is_either_an_action_or_a_key() -> None:
    """The message names the one that is both."""
    with pytest.raises(DomainError, match="'wall' as a key and as an action"):
        Vocabulary("maze", {"wall": Action("")}, {"wall": flag("")})


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (number("", 5, 5), "low < high"),
        (number("", 6, 5), "low < high"),
        (number("", 0, 2**53), "from -1,000,000 to 1,000,000"),
        (number("", 0, 5, 0), "a step from 1e-09 to high - low"),
        (number("", 0, 5, -1), "a step from 1e-09 to high - low"),
        (number("", 0, 5, 1e-300), "a step from 1e-09 to high - low"),
        (number("", 0, 5, most=-1), "most above low"),
        (number("", nan, 5), "a finite number as low"),
        (number("", 0, inf), "a finite number as high"),
        (number("", 0, 5, most=nan), "a finite number as most"),
        (integer("", 0, 10**400), "a finite number as high"),
    ],
)
def test_a_range_without_thresholds_is_rejected(entry: Key, message: str) -> None:
    """Random trees could draw no threshold from it, or one that the language cannot write."""
    with pytest.raises(DomainError, match="the key steps of the domain maze") as error:
        Vocabulary("maze", {}, {"steps": entry})
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (["Go"], "a valid dictionary for the action NAME"),
        ({3: Action("")}, "a valid string for the action 3"),
        ({"Go": Action("", statuses="0")}, "a valid frozenset as statuses"),  # type: ignore[arg-type]
        ({"Go": Action("", after="Go")}, "a valid tuple as after"),  # type: ignore[arg-type]
        ({"Go": Action("", to_start=(Condition("wall", "~", 0),))}, "one of is, not with wall"),
        ({"Go": Action("", changes={"wall": 2})}, "-1 or 1 as its changes"),
    ],
)
def test_an_odd_action_is_rejected(actions: Any, message: str) -> None:
    """The message names the field and the action."""
    with pytest.raises(DomainError, match=message):
        Vocabulary("maze", actions, {"wall": flag("")})


@pytest.mark.parametrize("values", ["idle", None, 3, []])
def test_words_are_a_list(values: Any) -> None:
    """A text is not taken for a list of its letters."""
    for declare in (enumeration, one_of):
        with pytest.raises(DomainError, match="Expected a list of words"):
            declare("mode of the robot", values)


@pytest.mark.parametrize("before", ["Fly", "wall"])
def test_an_action_comes_after_other_actions(before: str) -> None:
    """A name in `after` must be an action."""
    with pytest.raises(DomainError, match=f"`after` for the action Step .* found '{before}'"):
        Vocabulary("maze", {"Step": Action("", after=(before,))}, {"wall": flag("")})


def test_places_are_in_the_order_of_the_keys() -> None:
    """The index of a key on a blackboard is its place in the vocabulary."""
    assert MAZE.key_index == {"wall": 0, "steps": 1}


def test_what_always_holds() -> None:
    """A number is at least its least value, and at most its greatest where there is one."""
    assert MAZE.always == (Condition("steps", ">=", 0), Condition("steps", "<=", 99))
    assert Vocabulary("maze", {}, {"steps": number("", 1, 20)}).always == (
        Condition("steps", ">=", 1),
    )


def test_an_undeclared_action_may_do_anything() -> None:
    """Of an undeclared action nothing is known, as of one that declares a meaning alone."""
    assert MAZE.action("Fly") is UNKNOWN
    assert MAZE.action("Step").statuses == UNKNOWN.statuses == {FAILURE, SUCCESS, RUNNING}
    assert UNKNOWN.to_start == UNKNOWN.to_succeed == ()
    assert UNKNOWN.changes == {}


def test_vocabularies_are_values() -> None:
    """Equal ones are equal, also after a journey to a worker process."""
    assert pickle.loads(pickle.dumps(MAZE)) == MAZE != VOCABULARY
    assert EMPTY_VOCABULARY.actions == EMPTY_VOCABULARY.keys == {}


def test_a_tree_of_one_domain_is_not_one_of_another() -> None:
    """Names are those of the vocabulary that is given, and of no other."""
    text = "when wall { Step }"
    assert parse(text, MAZE) == Node(
        "when", (Condition("wall", "is", 0.0), "both"), (leaf("Step"),)
    )
    with pytest.raises(UnknownNameError, match="a blackboard key: batteryLevel"):
        parse(text, VOCABULARY)
    with pytest.raises(UnknownNameError, match=r"action \(Step, Turn\)"):
        parse("when wall { PatrolWaypoint }", MAZE)


def test_without_a_vocabulary_any_name_will_do() -> None:
    """Records are read so: they were checked when they were written."""
    tree = parse("when height > 3 { sequence { Climb when high { Jump } } }")
    assert tree.args == (Condition("height", ">", 3.0), "both")


def test_an_entry_of_another_type_is_refused() -> None:
    """A text in place of an action, as one writes it by mistake."""
    with pytest.raises(DomainError, match="an instance of Action for the action Step of the"):
        Vocabulary("maze", {"Step": "goes a step"}, {})  # type: ignore[dict-item] # the mistake


def test_whole_numbers() -> None:
    """An integer key has a whole range and evolves on whole numbers."""
    key = integer("how many", 0, 9, most=9)
    vocabulary = Vocabulary("d", {"Go": Action("goes")}, {"n": key})
    assert parse("when n < 3 { Go }", vocabulary).guard is not None
    assert parse("when n < 2.5 { Go }", vocabulary).guard is not None
    assert fine(3.4, key) == 3.0
    with pytest.raises(DomainError, match="Expected whole numbers as low, high, step and most"):
        Vocabulary("d", {}, {"n": replace(key, high=2.5)})
