"""`islandgp check`: each wrong file gives its error at its place, each doubtful one its warning."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.condition import condition
from islandgp.bt.core.language import parse, tree_errors
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, walk
from islandgp.bt.core.vocabulary import Action
from islandgp.domain import Scene
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import TreeError
from islandgp.resources import resource
from tests.composed import composed
from tests.running.commands import ROOT
from tests.site.generators import script
from tests.trees.shell import Cli
from tests.trees.worlds import random_trees, shortened

EXAMPLES = sorted((resource("grammar") / "examples").glob("*.bt"))


def test_all_errors_of_a_file() -> None:
    """Each wrong name and number is reported once, with its place, also in a subtree used twice."""
    text = (
        "subtree s = when lapp < 3 { PatrolWaypoint }\n"
        "selector { use s use s SekCharger repeater 0 { PatrolWaypoint } use t }"
    )
    errors = tree_errors(text, VOCABULARY, name="f", folder=None)
    assert [(e.line, e.column) for e in errors] == [(1, 18), (2, 24), (2, 44), (2, 69)]


@pytest.mark.parametrize("divided", ["lap <= -1 and batteryLevel / lap > 1", "1 / lap > lap"])
def test_a_divisor_that_has_no_value(divided: str) -> None:
    """A condition whose key cannot have a value that fits is judged as any other."""
    text = f"when {divided} {{ PatrolWaypoint }}"
    found = [each.code for each in warnings(text, VOCABULARY)]
    assert ("unreachable" in found) == ("-1" in divided)


def test_a_quoted_text_in_the_place_of_an_action() -> None:
    """It is shown whole."""
    with pytest.raises(TreeError, match="unexpected '\"zurück\"'"):
        parse('selector { "zurück" PatrolWaypoint }', VOCABULARY)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("selector {\n  sequence {\n    SeekCharger\n  }\n", 1),
        ("selector {\n  sequence {\n    SeekCharger\n", 2),
    ],
)
def test_unclosed_brace(text: str, line: int) -> None:
    """The innermost brace that is not closed is named by its line."""
    with pytest.raises(TreeError, match=f"the brace in line {line} is not closed"):
        parse(text, VOCABULARY)


def test_a_shared_subtree_is_judged_by_all_its_uses() -> None:
    """A guard that only one use needs is not called needless."""
    text = "subtree s = when lap < 3 { PatrolWaypoint }\n"
    plain = replace(VOCABULARY, actions={"PatrolWaypoint": Action("drives")})  # uses nothing
    mixed = text + "selector { when foundGarbage { use s } when lap < 3 abort self { use s } }"
    twice = text + "parallel { when lap < 2 { use s } when lap < 3 { use s } }"
    assert warnings(mixed, VOCABULARY) == []
    assert [w.code for w in warnings(twice, plain)] == ["needless-guard"]


def test_unused_names() -> None:
    """Constants and parameters that nothing uses are reported."""
    text = (
        "constant low = 2 constant high = 3\n"
        "subtree s(a, b) = when lap < a { PatrolWaypoint }\n"
        "selector { use s(low, 1) SeekCharger }"
    )
    places = [(w.code, w.line, w.column) for w in warnings(text, VOCABULARY)]
    assert places == [("unused-constant", 1, 27), ("unused-parameter", 2, 14)]


def test_mistakes() -> None:
    """docs/mistakes.md has 50 mistakes or more, each with the message that it gets today."""
    page, vocabulary = script("mistakes"), script("mistakes").vocabulary()
    assert page.PAGE.read_text(encoding="utf-8") == page.page()
    texts = [text for section in page.slips().values() for text in section]
    assert len(texts) == len(set(texts)) >= 50
    for text in texts:
        assert page.messages(text, vocabulary), text


def test_a_wrong_file(islandgp: Cli, tmp_path: Path) -> None:
    """A wrong file gives exit code 1 and its error where it is wrong, and no traceback."""
    file = tmp_path / "t.bt"
    file.write_text("selector {\n  MoveToGarbag\n}\n", encoding="utf-8")
    result = islandgp("check", file)
    assert (result.code, result.err) == (1, "")
    lines = result.out.splitlines()
    assert lines[0] == f"{file}:2:3: unknown action 'MoveToGarbag'"
    assert lines[1:3] == ["      MoveToGarbag", "      ^"]
    assert lines[-1] == "Did you mean MoveToGarbage?"


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_examples(islandgp: Cli, file: Path) -> None:
    """Every example is right, and only the poor one is doubtful."""
    result = islandgp("check", "--strict", file)
    assert result.code == (file.stem == "poor")


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
    ("when lap > 1 { when lap > 1 { SeekCharger } }", (1, 16), "is redundant"),
    ("when lap > 2 { sequence { when lap > 1 { SeekCharger } } }", (1, 27), "lap > 2 holds here"),
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
    ("when lap > 1 and lap < 1 { SeekCharger }", (1, 28), "can't hold on any blackboard"),
    ("when lap > 1 and foundGarbage and lap > 0 { SeekCharger }", (1, 1), "lap > 1 and found"),
    ("when not not not lap < 2 { SeekCharger }", (1, 1), "shorter one: lap >= 2"),
    (
        "when foundGarbage { when not foundGarbage or lap > 1 { SeekCharger } }",
        (1, 21),
        "shorter one: lap > 1",
    ),
    (
        "when foundGarbage or lap > 1 { when lap < 1 and not foundGarbage { SeekCharger } }",
        (1, 68),
        "foundGarbage or lap > 1 holds here",
    ),
    ("when not (foundGarbage or lap > 1) { MoveToGarbage }", (1, 38), "can never succeed"),
    ("subtree a = SeekCharger PatrolWaypoint", (1, 9), "never used"),
    ("when foundGarbage abort lower { MoveToGarbage }", (1, 1), "has no effect here"),
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


@pytest.mark.parametrize(("text", "place", "message"), DOUBTFUL, ids=[d[0] for d in DOUBTFUL])
def test_warning(text: str, place: tuple[int, int], message: str) -> None:
    """A doubtful place is pointed out, once, with its reason."""
    matching = [w for w in warnings(text, VOCABULARY) if message in w.message]
    assert [(w.line, w.column) for w in matching] == [place]


@pytest.mark.parametrize("text", FINE)
def test_no_warning(text: str) -> None:
    """What makes sense is left in peace, also near to what does not."""
    assert warnings(text, VOCABULARY) == []


def test_warning_in_a_subtree() -> None:
    """A mistake in a named subtree is reported once, where it is written."""
    text = "subtree a = inverter { inverter { SeekCharger } }\nselector { use a use a }"
    doubtful = [w for w in warnings(text, VOCABULARY) if "double" in w.message]
    assert [(w.line, w.column) for w in doubtful] == [(1, 13)]


SHADOWED = """selector {
  when lap > 1 { PatrolWaypoint }
  when lap > 1 { SeekCharger }
  when lap > 2 { MoveToGarbage }
  SeekCharger
}"""


def test_a_branch_that_earlier_ones_exclude_is_reported() -> None:
    """An action that never fails keeps later branches from running where its guard holds."""
    found = warnings(SHADOWED, VOCABULARY)
    assert [(w.line, w.code) for w in found] == [(3, "unreachable"), (4, "unreachable")]
    assert found[1].message == (
        "this branch can never run: lap > 2 can't hold, as lap <= 1 holds here"
    )
    may_fail = SHADOWED.replace("PatrolWaypoint", "PickupGarbage").replace(
        "SeekCharger", "ExecuteCharge"
    )
    assert not warnings(may_fail, VOCABULARY)
    (redundant,) = warnings(
        "selector { when lap > 1 { PatrolWaypoint } when lap <= 1 { MoveToGarbage } SeekCharger }",
        VOCABULARY,
    )
    assert redundant.code == "needless-guard"
    assert "as lap <= 1 holds here" in redundant.message


WHOLE = """selector {
  when lap == 2.05 { SeekCharger }
  when lap < 1.03 { MoveToGarbage }
  when robotCurrentExtraCapacity > 30 { DeliverToClearingPoint }
  PatrolWaypoint
}"""


def test_thresholds_of_whole_numbers(islandgp: Cli, tmp_path: Path) -> None:
    """Decimals have no effect, or the condition never holds; nor does one above the capacity."""
    (tmp_path / "t.bt").write_text(WHOLE, encoding="utf-8")
    lines = islandgp("check", tmp_path / "t.bt").out.splitlines()
    found = [line.partition("warning: ")[2] for line in lines if "warning: " in line]
    assert len(found) == 3
    assert found[0].startswith(
        "this branch can never run: lap == 2.05 can't hold, as lap is a whole"
    )
    assert found[1] == "of whole numbers, lap < 1.03 is lap < 2"
    assert "robotCurrentExtraCapacity > 30 can't hold" in found[2]
    larger = islandgp("check", tmp_path / "t.bt", "--set", "world.robot.capacity=40").out
    assert "robotCurrentExtraCapacity > 30 can't hold" not in larger


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("when foundGarbage abort self { PickupGarbage }", "its child ends in the tick"),
        ("when lap > 1 { sequence { SeekCharger when lap > 0 abort self { MoveToGarbage } } }", ""),
        (
            "selector { when lap > 1 { SeekCharger } when lap > 0 { when lap > 1 abort lower {"
            " MoveToGarbage } } PatrolWaypoint }",
            "",
        ),
    ],
)
def test_an_abort_rule_without_effect_is_reported(text: str, reason: str) -> None:
    """Where it can stop neither its child nor a later branch; other warnings come first."""
    (found,) = warnings(text, VOCABULARY)
    assert (found.code == "needless-abort") == bool(reason)
    assert reason in found.message


def test_a_warning_names_the_uses_to_which_it_applies() -> None:
    """A branch that can run in some uses of its subtree only is reported with the other uses."""
    text = "subtree chk(p) = when batteryLevel < p { SeekCharger }\nselector { %s PatrolWaypoint }"
    (warning,) = warnings(text % "use chk(-3) use chk(50)", VOCABULARY)
    assert warning.message.startswith("this branch can never run: batteryLevel < p can't hold")
    assert (warning.line, warning.column) == (2, 12)
    (warning,) = warnings(text % "use chk(-3) use chk(-4)", VOCABULARY)
    assert warning.message.endswith("0 to 100")
    inner = "subtree twice(q) = sequence { use chk(q) }\n"
    found = warnings(
        text.replace("\n", f"\n{inner}") % "use twice(-1) use twice(9) use chk(-2) use chk(50)",
        VOCABULARY,
    )
    assert [(each.line, each.column) for each in found] == [(3, 12), (3, 39)]
    loop = "for x in [3, 0] { when lap < x { SeekCharger } }"
    assert [(each.line, each.column) for each in warnings(loop, VOCABULARY)] == [(1, 34)]


def test_a_file_that_is_not_utf_8_is_refused(islandgp: Cli, tmp_path: Path) -> None:
    """A file that is not UTF-8 gives one clear line and exit code 2."""
    file = tmp_path / "t.bt"
    file.write_bytes(b"# caf\xe9\nPatrolWaypoint")
    result = islandgp("check", file)
    assert result.code == 2
    assert "Expected UTF-8" in result.err


class Facts:
    """An observer that compares the vocabulary's facts about actions with their results."""

    def __init__(self, tree: Node, counts: Counter[tuple[str, int]]) -> None:
        self.names = [n.action for n in walk(tree)]
        self.results: list[tuple[str, int]] = []
        self.counts = counts

    def node(self, place: int, status: int) -> None:
        if self.names[place] and status in (FAILURE, SUCCESS, RUNNING):
            self.results.append((self.names[place], status))

    def credit(self, component: str, points: float, event: str, action: str) -> None:
        pass

    def tick(self, values: Sequence[float], _: Scene | None) -> None:
        board = dict(zip(VOCABULARY.keys, values, strict=True))
        changed: set[str] = set()  # keys, by an action earlier in this tick
        for name, status in self.results:
            action = VOCABULARY.actions[name]
            assert status in action.statuses
            self.counts[name, status] += 1
            if status == SUCCESS:
                for need in action.to_succeed:
                    if need.key not in changed:
                        assert condition(need, values, VOCABULARY.key_index)(), (name, need, board)
                changed |= action.changes.keys()
        self.results.clear()


@pytest.mark.slow
def test_facts_about_actions_hold_on_the_island() -> None:
    """In random episodes no action returns what the vocabulary denies, nor succeeds without its
    needs."""
    settings = composed()
    domain = shortened(settings, 120, stagnation=120, negative=120).make_domain()
    weights = settings.curriculum.multipliers(0)
    counts: Counter[tuple[str, int]] = Counter()
    for tree in random_trees(settings, 20):
        domain.run_episode(tree, 7, weights, Facts(tree, counts))
    assert {name for name, status in counts if status == SUCCESS} >= {
        "MoveToGarbage",
        "PickupGarbage",
        "SeekCharger",
        "PatrolWaypoint",
    }


HALF = "when batteryLevel >= {level} abort self {{ sequence {{ SeekCharger ExecuteCharge }} }}"
EARLY = "+curriculum.stages.0.world={robot: {charge_below: 80}}"


@pytest.mark.parametrize(
    ("level", "options", "warned"),
    [
        (60, [], True),  # conf/world/island.yaml has 50
        (45, [], False),
        (60, ["--set", "world=dense"], False),
        (95, ["--set", "world=dense"], True),
        (60, ["--set", "search=paper", "--set", EARLY], False),  # one stage's world is enough
        (80, ["--set", "search=paper", "--set", EARLY], True),
    ],
)
def test_where_the_robot_cannot_charge_follows_the_world(
    islandgp: Cli, tmp_path: Path, level: int, options: list[str], warned: bool
) -> None:
    """A charge that can never start is pointed out, by `charge_below` of the configured worlds."""
    file = tmp_path / "t.bt"
    file.write_text(HALF.format(level=level), encoding="utf-8")
    result = islandgp("check", file, *options)
    assert (result.code, result.err) == (0, "")
    assert (
        "ExecuteCharge can never succeed here: it needs batteryLevel < " in result.out
    ) == warned


def test_the_vocabulary_of_the_domain_that_the_file_names(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`domain NAME` in a file chooses the vocabulary, also among files of several domains."""
    home = ROOT / "examples/pick_place"
    monkeypatch.syspath_prepend(home)
    other, ours = tmp_path / "other.bt", tmp_path / "ours.bt"
    other.write_text("domain pick_place\nselector { when not localised { Localise } Tuck }\n")
    ours.write_text("PatrolWaypoint\n")
    result = islandgp("check", "--config-dir", home / "conf", other, ours)
    assert (result.code, result.err) == (0, "")
    assert "4 nodes" in result.out
    ours.write_text("Tuck\n")
    result = islandgp("check", "--config-dir", home / "conf", ours)
    assert result.code == 1
    assert "Tuck" in result.out
    chosen = ("--config-dir", home / "conf", "--set", "domain=pick_place")
    assert islandgp("check", *chosen, ours).code == 0


@pytest.mark.parametrize(
    "arguments",
    [("simplify",), ("export", "--to", "pytrees"), ("play",), ("replay",)],
    ids=lambda arguments: arguments[0],
)
def test_a_domain_that_is_not_there(
    islandgp: Cli, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    """The message has the place and the remedy; exit code 2."""
    file = tmp_path / "t.bt"
    file.write_text("domain maze\nForward\n")
    result = islandgp(*arguments, file)
    assert (result.code, result.out) == (2, "")
    domains = "cartpole, island, lunarlander, mountaincar, pendulum, swimmer"
    place, line, caret, expected = result.err.splitlines()
    assert place == f"islandgp: {file}:1:8: unknown domain 'maze'"
    assert (line.strip(), caret.index("^")) == ("domain maze", line.index("maze"))
    assert expected.startswith(f"Expected a domain that is configured ({domains}); give --")


def test_check_goes_on_after_a_file_of_a_domain_that_is_not_there(
    islandgp: Cli, tmp_path: Path
) -> None:
    """It is an error of that file, at the place of the name."""
    maze, ours = tmp_path / "maze.bt", tmp_path / "ours.bt"
    maze.write_text("# a maze\ndomain maze\nForward\n")
    ours.write_text("PatrolWaypoint\n")
    result = islandgp("check", maze, ours)
    assert (result.code, result.err) == (1, "")
    first, *_, second = result.out.splitlines()
    assert first.startswith(f"{maze}:2:8: unknown domain 'maze'")
    assert second.startswith(f"{ours}: 1 node, ")
    (entry,) = json.loads(islandgp("check", "--json", maze, ours).out)
    assert (entry["line"], entry["column"], entry["end"]) == (2, 8, 12)
    assert entry["code"] == "domain"
    assert entry["message"].startswith("unknown domain 'maze'. Expected a domain")


def test_another_domain_than_the_file_names(islandgp: Cli, tmp_path: Path) -> None:
    """The user's choice applies, and a file for another domain is refused."""
    file = tmp_path / "t.bt"
    file.write_text("domain maze\nForward\n")
    result = islandgp("check", "--set", "domain=island", file)
    assert result.code == 1
    assert "the tree is for the domain 'maze', not for 'island'" in result.out
    result = islandgp("play", "--set", "domain=island", file)
    assert result.code == 2
    assert "the tree is for the domain 'maze', not for 'island'" in result.err


@pytest.mark.parametrize(
    "arguments", [("fmt", "--check"), ("show",)], ids=lambda arguments: arguments[0]
)
def test_no_vocabulary_is_needed(islandgp: Cli, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    """`fmt` and `show` take trees of any domain."""
    file = tmp_path / "t.bt"
    file.write_text("domain maze\n\nselector { Forward Turn }\n")
    assert islandgp(*arguments, file).code == 0


DOUBTFUL = {
    "unreachable": "selector { PatrolWaypoint MoveToGarbage }",
    "needless-guard": "when foundGarbage { when foundGarbage { PatrolWaypoint } }",
    "long-condition": "when lap > 1 and lap > 0 { PatrolWaypoint }",
    "whole-number": "when lap < 1.5 { MoveToGarbage }",
    "double-inverter": "inverter { inverter { PatrolWaypoint } }",
    "never-succeeds": "when batteryLevel < 15 { ExecuteCharge }",
    "needless-abort": "when foundGarbage abort lower { PatrolWaypoint }",
    "parallel-count": "parallel success 3 { PatrolWaypoint PickupGarbage }",
    "unused-subtree": "subtree x = PatrolWaypoint\nPatrolWaypoint",
    "unused-constant": "constant x = 1\nPatrolWaypoint",
    "unused-parameter": "subtree s(x) = PatrolWaypoint\nuse s(1)",
}


def test_codes() -> None:
    """Each kind of warning has a code, which is documented."""
    page = (ROOT / "docs" / "language.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| warning \| (.*) \|$", page, re.MULTILINE)
    assert row == ", ".join(f"`{code}`" for code in DOUBTFUL)
    for code, text in DOUBTFUL.items():
        assert code in {finding.code for finding in warnings(text, VOCABULARY)}


def test_json(islandgp: Cli, tmp_path: Path) -> None:
    """Findings as JSON have their file, place, severity and code; one of an included file its."""
    valid, invalid, part = (tmp_path / name for name in ("a.bt", "b c.bt", "part.bt"))
    valid.write_text("selector { PatrolWaypoint MoveToGarbage }")
    invalid.write_text('include "part.bt"\nuse x')
    part.write_text("subtree x = MoveToGarbag")
    result = islandgp("check", "--json", valid, invalid)
    doubtful, error = json.loads(result.out)
    assert result.code == 1
    assert doubtful.pop("message").startswith("this branch can never run")
    assert doubtful == {
        "file": str(valid), "line": 1, "column": 27, "end": 40,
        "severity": "warning", "code": "unreachable",
    }  # fmt: skip
    assert error.pop("message").endswith("Did you mean MoveToGarbage?")
    assert error == {
        "file": str(part), "line": 1, "column": 13, "end": 25,
        "severity": "error", "code": "unknown-name",
    }  # fmt: skip
    assert islandgp("check", "--json", "-", stdin="PatrolWaypoint").out == "[]\n"
