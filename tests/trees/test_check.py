"""`islandgp check`: each wrong file gives its error at its place, each doubtful one its warning."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

from islandgp.bt.facts import FACTS
from islandgp.bt.lint import warnings
from islandgp.bt.node import FAILURE, KEYS, RUNNING, SUCCESS, Node, walk
from islandgp.bt.truth import HOLDS
from islandgp.island.episode import run_episode
from islandgp.island.state import Island
from islandgp.resources import resource
from islandgp.scoring.rewards import award
from tests.composed import composed
from tests.goldens import check_golden
from tests.trees.shell import Cli
from tests.trees.worlds import random_trees

WRONG = Path(__file__).parent / "wrong"
EXAMPLES = sorted((resource("grammar") / "examples").glob("*.bt"))

PLACES = {
    "abort_before_condition": (1, 6),
    "action_in_lower_case": (1, 1),
    "brace_not_closed": (2, 17),
    "brace_too_many": (1, 29),
    "commas": (1, 25),
    "comparison_without_number": (1, 21),
    "empty": (1, 1),
    "empty_composite": (1, 12),
    "exponent": (1, 21),
    "flag_compared": (1, 6),
    "guard_with_two_children": (1, 35),
    "guard_without_child": (1, 18),
    "inverter_with_two_children": (1, 26),
    "key_on_the_right": (1, 6),
    "letters_in_the_number": (1, 21),
    "no_brace": (1, 10),
    "not_with_a_number": (1, 10),
    "number_out_of_range": (1, 12),
    "number_without_comparison": (1, 6),
    "one_equals_sign": (1, 10),
    "only_a_comment": (1, 1),
    "only_a_subtree": (1, 28),
    "policies_swapped": (1, 22),
    "quotes": (1, 21),
    "repeater_fraction": (1, 10),
    "repeater_without_number": (1, 10),
    "repeater_zero": (1, 10),
    "round_brackets": (1, 10),
    "strange_sign": (1, 18),
    "subtree_behind_the_tree": (2, 1),
    "subtree_later": (1, 17),
    "subtree_named_by_a_word": (1, 9),
    "subtree_of_itself": (1, 28),
    "subtree_twice": (2, 9),
    "subtree_without_use": (2, 12),
    "two_conditions": (1, 19),
    "two_trees": (2, 1),
    "unit_behind_the_number": (1, 23),
    "unknown_abort": (1, 25),
    "unknown_action": (2, 3),
    "unknown_key": (1, 6),
    "unknown_kind": (1, 1),
    "unknown_policy": (1, 18),
    "unknown_subtree": (2, 5),
    "wrong_operator": (1, 10),
}
"""Where each wrong file is wrong: line and column, found by reading it."""


def test_every_wrong_file_has_its_place() -> None:
    """The table names the files that there are, and there are forty or more."""
    assert {file.stem for file in WRONG.glob("*.bt")} == PLACES.keys()
    assert len(PLACES) >= 40


@pytest.mark.parametrize("name", PLACES)
def test_wrong_file(islandgp: Cli, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """A wrong file gives exit code 1 and its error where it is wrong, and no traceback."""
    monkeypatch.chdir(WRONG)
    said = islandgp("check", f"{name}.bt")
    assert said.code == 1
    line, column = PLACES[name]
    assert said.out.startswith(f"{name}.bt:{line}:{column}: ")
    assert "Traceback" not in said.out + said.err
    caret = next(row for row in said.out.splitlines() if row.strip() == "^")
    assert caret.index("^") == 4 + column - 1


def test_golden_errors(islandgp: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """All errors together are what somebody has read and found helpful."""
    monkeypatch.chdir(WRONG)
    check_golden("wrong_trees.txt", islandgp("check", *(f"{name}.bt" for name in PLACES)).out)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_examples(islandgp: Cli, file: Path) -> None:
    """Every example is right, and only the poor one is doubtful."""
    said = islandgp("check", "--strict", file)
    assert said.code == (file.stem == "poor")


# The text of a tree, and where a warning is expected with which words.
DOUBTFUL = [
    ("selector { PatrolWaypoint MoveToGarbage }", (1, 27), "can never run: PatrolWaypoint"),
    (
        "sequence { when foundGarbage { when not foundGarbage { SeekCharger } } PatrolWaypoint }",
        (1, 56),
        "not foundGarbage can't hold",
    ),
    ("when batteryLevel > 100 { SeekCharger }", (1, 27), "0 to 100"),
    ("when lap < 0 { SeekCharger }", (1, 16), "can never run"),
    ("when lap > 1 { when lap > 1 { SeekCharger } }", (1, 16), "says nothing new"),
    ("when lap > 2 { sequence { when lap > 1 { SeekCharger } } }", (1, 27), "when lap > 2"),
    ("when batteryLevel >= 0 { SeekCharger }", (1, 1), "always holds"),
    ("inverter { inverter { SeekCharger } }", (1, 1), "double inverter"),
    ("when not foundGarbage { MoveToGarbage }", (1, 25), "MoveToGarbage can never succeed"),
    ("when not isHumanoidWantToClear { MoveToHumanoid }", (1, 34), "can never succeed"),
    ("when robotCurrentExtraCapacity < 1 { PickupGarbage }", (1, 38), "can never succeed"),
    (
        "when robotCurrentExtraCapacity > 29 { DeliverToClearingPoint }",
        (1, 39),
        "can never succeed",
    ),
    ("when batteryLevel < 30 { ExecuteCharge }", (1, 26), "ExecuteCharge can never succeed"),
    ("when batteryLevel >= 95 abort none { ExecuteCharge }", (1, 38), "can never succeed"),
    ("subtree a = SeekCharger PatrolWaypoint", (1, 9), "never used"),
    ("when foundGarbage abort lower { MoveToGarbage }", (1, 1), "is abort none here"),
]
FINE = [
    "when batteryLevel < 30 abort none { ExecuteCharge }",
    "when lap > 1 { when lap > 2 { SeekCharger } }",
    "when lap > 1 abort none { sequence { SeekCharger when lap > 1 { PatrolWaypoint } } }",
    "when robotCurrentExtraCapacity < 1 { sequence { DeliverToClearingPoint PickupGarbage } }",
    "selector { when foundGarbage abort lower { MoveToGarbage } PatrolWaypoint }",
    "inverter { PatrolWaypoint }",
    "subtree a = SeekCharger subtree b = use a use b",
]


@pytest.mark.parametrize(("text", "place", "words"), DOUBTFUL, ids=[d[0] for d in DOUBTFUL])
def test_warning(text: str, place: tuple[int, int], words: str) -> None:
    """A doubtful place is pointed out, once, with its reason."""
    found = [w for w in warnings(text) if words in w.message]
    assert [(w.line, w.column) for w in found] == [place]


@pytest.mark.parametrize("text", FINE)
def test_no_warning(text: str) -> None:
    """What makes sense is left in peace, also near to what does not."""
    assert warnings(text) == []


def test_warning_in_a_subtree() -> None:
    """What is wrong in a named subtree is told once, where it is written."""
    text = "subtree a = inverter { inverter { SeekCharger } }\nselector { use a use a }"
    doubtful = [w for w in warnings(text) if "double" in w.message]
    assert [(w.line, w.column) for w in doubtful] == [(1, 13)]


def test_limits(islandgp: Cli, tmp_path: Path) -> None:
    """A tree larger than asked for is an error that names the file."""
    file = tmp_path / "t.bt"
    file.write_text("selector { SeekCharger PatrolWaypoint }")
    assert islandgp("check", file).code == 0
    said = islandgp("check", "--max-nodes", 2, file)
    assert said.code == 1
    assert re.search(r"t\.bt: .*at most 2 nodes, found 3", said.out)


def test_other_encodings(islandgp: Cli, tmp_path: Path) -> None:
    """A file that is not UTF-8 gives one clear line and exit code 2."""
    file = tmp_path / "t.bt"
    file.write_bytes(b"# caf\xe9\nPatrolWaypoint")
    said = islandgp("check", file)
    assert said.code == 2
    assert "Expected UTF-8" in said.err


def test_facts_about_actions_hold_on_the_island() -> None:
    """In random episodes no action returns what `facts` denies, nor succeeds without its needs."""
    settings = composed()
    world = settings.world
    episode = world.episode.model_copy(update={"length": 120, "stagnation": 120, "negative": 120})
    world = world.model_copy(update={"episode": episode})
    points = award(settings.rewards, settings.curriculum.multipliers(0))
    seen: Counter[tuple[str, int]] = Counter()

    def look(tree: Node) -> None:
        names = [str(n.args[0]) if n.kind == "action" else "" for n in walk(tree)]
        told: list[tuple[str, int]] = []

        def watch(place: int, status: int) -> None:
            if names[place] and status in (FAILURE, SUCCESS, RUNNING):
                told.append((names[place], status))

        def observe(island: Island) -> None:
            board = dict(zip(KEYS, island.board, strict=True))
            changed = False  # the room, by an action earlier in this tick
            for name, status in told:
                fact = FACTS[name]
                assert status in fact.statuses
                seen[name, status] += 1
                if status == SUCCESS:
                    for key, operator, number in fact.to_succeed:
                        if not (changed and key == "robotCurrentExtraCapacity"):
                            assert HOLDS[operator](board[key], number), (name, key, board)
                    changed = changed or fact.room != 0
            told.clear()

        run_episode(tree, world, 7, points, stepwise=True, watch=watch, observe=observe)

    for tree in random_trees(settings, 40):
        look(tree)
    assert {name for name, status in seen if status == SUCCESS} >= {
        "MoveToGarbage",
        "PickupGarbage",
        "SeekCharger",
        "PatrolWaypoint",
    }
