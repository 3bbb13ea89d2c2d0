"""Rules of guards: proofs and refutations are exact, bounded, and reported in a line."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner
from every_tick import all_boards, every_tick
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from islandgp.bt.core.condition import ConditionExpr, condition
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, leaf, walk
from islandgp.bt.core.parameters import one_of, real, switch, text
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag
from islandgp.cli import islandgp
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import TreeError
from islandgp.resources import resource
from islandgp_verify.rules import Rule, RuleResult, check_rule, read_rule
from tests.bt.stage import short_text, short_tree
from tests.bt.test_words_of_keys import BOT, TREE, read
from tests.profiles import examples
from tests.running.commands import ROOT
from tests.strategies import conditions, few_numbers, nodes

MOST_TICKS = 4_000
ALL_ROUNDER = str(resource("grammar") / "examples" / "all_rounder.bt")


def short_rule(text: str) -> Rule:
    """A rule from its short text; see `tests.bt.stage`."""
    return read_rule(short_text(text), VOCABULARY)


def check(tree: Node, action: str, expr: ConditionExpr, steps: int = 10**6) -> RuleResult:
    """The result of checking a rule."""
    return check_rule(tree, Rule("a rule", (action,), expr), VOCABULARY, steps)


def holds(expr: ConditionExpr, board: list[float]) -> bool:
    """Whether a condition holds on a blackboard."""
    return condition(expr, board, VOCABULARY.key_index)()


def compare(tree: Node, action: str, expr: ConditionExpr) -> None:
    """Fails where a result is not that of all sequences of ticks on the real engine."""
    boards = all_boards(tree, VOCABULARY, expr)
    ticked = every_tick(tree, boards, VOCABULARY, MOST_TICKS)
    assume(ticked is not None)
    assert ticked is not None
    leaves = {p for p, node in enumerate(walk(tree)) if node == leaf(action)}
    broken = {place for place, at in ticked if place in leaves and holds(expr, boards[at])}
    rule_result = check(tree, action, expr)
    assert rule_result.result == ("refuted" if broken else "proven")
    if rule_result.result == "refuted":
        assert rule_result.place in broken
        last = rule_result.ticks[-1]
        assert rule_result.place in dict(last.statuses)  # as the engine did it
        board = [last.board.get(key, 0.0) for key in VOCABULARY.keys]
        assert holds(expr, board)


SMALL = nodes(
    few_numbers(),
    always=False,
    max_leaves=5,
    max_repeats=2,
    timed=False,
    reactive=False,
    nav2=False,
    if_else=False,
)
ACTIONS = st.sampled_from(list(VOCABULARY.actions))


@examples(max_examples=80, deadline=None)
@given(SMALL, st.data(), conditions(few_numbers()))
def test_results_are_those_of_all_ticks(
    tree: Node, data: st.DataObject, expr: ConditionExpr
) -> None:
    """A rule is refuted if, and only if, some sequence of ticks of the engine breaks it."""
    names = sorted({node.action for node in walk(tree) if node.action})
    compare(tree, data.draw(st.sampled_from(names)), expr)


@examples(max_examples=80, deadline=None)
@given(
    nodes(few_numbers(), always=False, max_leaves=5, max_repeats=2),
    ACTIONS,
    conditions(few_numbers()),
)
def test_proofs_of_timed_and_reactive_trees(tree: Node, action: str, expr: ConditionExpr) -> None:
    """Of a tree with a clock or a reactive composite, what is proven is not broken by any tick."""
    # These count outside of cells.
    assume(not any(node.kind in ("cooldown", "every") for node in walk(tree)))
    boards = all_boards(tree, VOCABULARY, expr)
    ticked = every_tick(tree, boards, VOCABULARY, MOST_TICKS)
    assume(ticked is not None)
    leaves = {p for p, node in enumerate(walk(tree)) if node == leaf(action)}
    broken = any(place in leaves and holds(expr, boards[at]) for place, at in ticked or ())
    assert check(tree, action, expr).result != ("proven" if broken else "refuted")


@pytest.mark.slow
@settings(max_examples=3_000, deadline=None)
@given(
    nodes(
        few_numbers(),
        always=False,
        max_leaves=7,
        max_repeats=3,
        timed=False,
        reactive=False,
        nav2=False,
        if_else=False,
    ),
    ACTIONS,
    conditions(few_numbers()),
)
def test_results_of_many_trees(tree: Node, action: str, expr: ConditionExpr) -> None:
    """The same for more and larger trees, and for actions that may be missing."""
    compare(tree, action, expr)


PROVEN = [
    ("when p { A }", "never A while not p"),
    ("selector { when x < 20 abort lower { C } A }", "never A while x < 10"),
    ("A", "never B while p"),
    ("A", "never A while x < -1"),
    ("A", "never A while p and not p"),
    # Behind the walk: E starts in the tick after A failed, and there only.
    ("when p abort none { sequence { C B } }", "never B while not p and x < 0"),
]
REFUTED = [
    ("when p abort none { A }", "never A while not p", 2),
    ("A", "never A while p", 1),
    ("when p abort none { sequence { A A D } }", "never D while not p", 2),
    ("repeater 3 { when p abort none { A } }", "never A while not p", 2),
]


@pytest.mark.parametrize(("text", "rule"), PROVEN)
def test_proofs(text: str, rule: str) -> None:
    """What follows from guards, ranges of keys, and actions that are not there."""
    proof = check_rule(short_tree(text), short_rule(rule), VOCABULARY)
    assert (proof.result, proof.ticks) == ("proven", ())


@pytest.mark.parametrize(("text", "rule", "ticks"), REFUTED)
def test_refutations(text: str, rule: str, ticks: int) -> None:
    """With as few ticks as break the rule."""
    refutation = check_rule(short_tree(text), short_rule(rule), VOCABULARY)
    assert (refutation.result, len(refutation.ticks)) == ("refuted", ticks)


def test_steps_bound_the_work() -> None:
    """A rule that takes more is reported as unknown."""
    hard = short_tree("when p abort none { selector { inverter { A } sequence { D A } } }")
    rule_result = check_rule(hard, short_rule("never A while not p"), VOCABULARY, steps=1)
    assert (rule_result.result, "--steps" in rule_result.why) == ("unknown", True)


WRONG = [
    ("", "expected never ACTION while CONDITION, found another form"),
    ("never", "expected never ACTION while CONDITION, found another form"),
    ("always PatrolWaypoint while foundGarbage", "expected never ACTION while CONDITION, found"),
    ("never PatrolWaypoin while foundGarbage", "unknown action 'PatrolWaypoin'. Expected"),
    ("never PatrolWaypoint while batteryLevl < 1", "unknown blackboard key 'batteryLevl'. Exp"),
    ("never PatrolWaypoint while foundGarbage { SeekCharger } #", "expected a condition after"),
    ("never PatrolWaypoint while foundGarbage abort self", "expected a condition after while"),
    ("never PatrolWaypoint while batteryLevel < 1e999", ""),
    ("never selector while foundGarbage", ""),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_wrong_rules(text: str, message: str) -> None:
    """One line that names the rule."""
    with pytest.raises(TreeError) as error:
        read_rule(text, VOCABULARY)
    assert str(error.value).startswith(f"rule {text!r}: {message}")
    assert "\n" not in str(error.value)


def verify_tree(*arguments: str) -> tuple[int, str]:
    """Exit code and output of the command."""
    result = CliRunner().invoke(islandgp, ["verify-tree", *arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit | TreeError)
    return result.exit_code, result.output


def test_the_command_shows_a_counterexample() -> None:
    """Blackboards and statuses of nodes, tick by tick; the last one is marked."""
    code, text = verify_tree(
        ALL_ROUNDER,
        "never MoveToGarbage while not foundGarbage",
        "never ExecuteCharge while batteryLevel > 90",
    )
    first, *lines = text.splitlines()
    assert code == 1
    assert first.endswith(
        "never MoveToGarbage while not foundGarbage: proven, it follows from the guards"
    )
    assert lines[0].endswith("never ExecuteCharge while batteryLevel > 90: refuted, in 2 ticks")
    assert lines[1].startswith("  tick 1: batteryLevel ")
    assert lines[-1].endswith("ExecuteCharge: RUNNING  <- the rule is broken here")


def test_the_command_as_json(tmp_path: Path) -> None:
    """Exit code 0 where all rules are proven; a file's name may hold a space."""
    file = tmp_path / "a tree.bt"
    file.write_text("domain island\n\nwhen foundGarbage { MoveToGarbage }\n", encoding="utf-8")
    rule = "never MoveToGarbage while not foundGarbage"
    code, text = verify_tree(str(file), rule, "--json")
    (result,) = json.loads(text)
    assert code == 0
    assert (result["rule"], result["result"], result["ticks"]) == (rule, "proven", [])
    code, text = verify_tree(str(file), "never MoveToGarbage while foundGarbage", "--json")
    (result,) = json.loads(text)
    assert code == 1
    assert [node["status"] for node in result["ticks"][0]["nodes"]] == ["RUNNING", "RUNNING"]


def test_the_page_shows_what_the_commands_print(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The example of README.md, run unchanged."""
    page = (ROOT / "plugins/verify/README.md").read_text(encoding="utf-8")
    ((kind, shell), (_, expected)) = re.findall(
        r"^```(sh|text) rules\n(.*?)^```", page, re.MULTILINE | re.DOTALL
    )
    assert kind == "sh"
    monkeypatch.chdir(tmp_path)
    first, *others = map(shlex.split, shell.splitlines())
    Path(first[-1]).write_text(CliRunner().invoke(islandgp, first[1:-2]).output, encoding="utf-8")
    outputs = [CliRunner().invoke(islandgp, command[1:]).output for command in others]
    assert "".join(outputs) == expected


ROBOT = Vocabulary(
    "robot",
    {
        "Drive": Action(
            "",
            arguments={
                "speed": real("", 0.0, 1.0, default=0.8),
                "to": one_of("", ("dock", "door")),
                "careful": switch(""),
                "frame": text(""),
            },
            uses=("base",),
        ),
        "Turn": Action("", uses=("base", "arm")),
        "Beep": Action(""),
    },
    {"near": flag("")},
)
CALLS = """selector {
  when near { Drive(speed: 0.5, to: door) }
  when not near { sequence { Drive(to: dock) Drive(careful: yes) Turn } }
  Beep
}"""


@pytest.mark.parametrize(
    ("rule", "result"),
    [
        ("never Drive(speed > 0.5) while near", "proven"),
        ("never Drive(speed >= 0.5) while near", "refuted"),
        ("never Drive(speed > 0.75) while not near", "refuted"),  # the default
        ("never Drive ( to == dock and not careful ) while near", "proven"),
        ("never Drive(to == door) while near", "refuted"),
        ("never Drive(careful and (to == dock or speed < 1)) while not near", "refuted"),
        ("never Drive(speed > 0.9) while near", "proven"),
        ("never Drive while near", "refuted"),
        ("never base while near", "refuted"),
        ("never arm while near", "proven"),
        ("never arm while not near", "refuted"),
    ],
)
def test_rules_of_arguments_and_resources(rule: str, result: str) -> None:
    """They are about the calls with such arguments, or of actions that use the resource."""
    tree = parse(CALLS, ROBOT)
    assert check_rule(tree, read_rule(rule, ROBOT), ROBOT).result == result


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        ("never Drive(sped > 0.5) while near", "unknown blackboard key 'sped'"),
        ("never Drive(frame == map) while near", "unknown blackboard key 'frame'"),
        ("never Drive() while near", "expected never ACTION while CONDITION, found another form"),
        ("never base(speed > 1) while near", "expected arguments of an action, found base(...)"),
        ("never bas while near", "unknown action 'bas'"),
    ],
)
def test_wrong_rules_of_arguments(rule: str, message: str) -> None:
    """A line that names the rule and the reason."""
    with pytest.raises(TreeError, match=re.escape(f"rule {rule!r}: {message}")):
        read_rule(rule, ROBOT)


@pytest.mark.parametrize(
    ("rule", "result"),
    [
        ("never Dock while charge >= reserve", "proven"),
        ("never Dock while reserve <= charge", "proven"),
        ("never Dock while mode == driving", "proven"),
        ("never Drive while mode == idle", "unknown"),
    ],
)
def test_rules_of_words(rule: str, result: str) -> None:
    """Guards prove rules of words and of two keys; without that, nothing is claimed."""
    assert check_rule(read(TREE), read_rule(rule, BOT), BOT).result == result
