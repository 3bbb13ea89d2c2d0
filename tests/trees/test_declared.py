"""Trees for robots whose domain is not installed: vocabularies from files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from islandgp import load_tree
from islandgp.bt.core.condition import Condition
from islandgp.bt.core.language import parse
from islandgp.bt.core.parameters import Parameter
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag, number
from islandgp.bt.export.declared import declared
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError
from tests.trees.shell import Cli

MODEL = """<root BTCPP_format="4" main_tree_to_execute="Go Home">
  <BehaviorTree ID="Go Home">
    <Fallback>
      <ReactiveSequence>
        <ScriptCondition code="charge &lt; 25.5 &amp;&amp; !docked"/>
        <SubTree ID="dock it" _autoremap="true"/>
      </ReactiveSequence>
      <Sequence><IsTired/><Drive/></Sequence>
    </Fallback>
  </BehaviorTree>
  <BehaviorTree ID="dock it"><Drive/></BehaviorTree>
  <TreeNodesModel>
    <Action ID="Drive"/><Condition ID="IsTired"/><Control ID="Odd"/>
  </TreeNodesModel>
</root>
"""
LIFT_VOCABULARY = Vocabulary(
    "lift",
    {"Up": Action("rises", changes={"floor": 1}), "Open": Action("", frozenset({1}))},
    {"floor": number("where it is", -1.5, 9, 0.5, most=8.0), "busy": flag("someone waits")},
)
LIFT = {
    "domain": "lift",
    "actions": {
        "Up": {"meaning": "rises", "changes": {"floor": 1}},
        "Open": {"statuses": ["SUCCESS"], "to_start": []},
    },
    "keys": {
        "floor": {"meaning": "where it is", "flag": False, "low": -1.5, "high": 9, "step": 0.5,
                  "most": 8},
        "busy": {"meaning": "someone waits"},
    },
}  # fmt: skip


def test_domain_as_json(islandgp: Cli) -> None:
    """What `domain --json` prints is the domain's vocabulary."""
    assert declared(islandgp("domain", "--json").out, "", name="d.json") == VOCABULARY


def test_json_by_hand() -> None:
    """A vocabulary alone does, and what it leaves out has the defaults of a declaration."""
    assert declared(json.dumps(LIFT), "", name="lift.json") == LIFT_VOCABULARY


def test_a_range_makes_a_number() -> None:
    """A key with a range and without `flag` is a number."""
    declaration = {"domain": "drone", "actions": {}, "keys": {"height": {"low": 0, "high": 120.5}}}
    vocabulary = declared(json.dumps(declaration), "", name="drone.json")
    assert vocabulary.keys["height"] == number("", 0, 120.5)


def test_model(islandgp: Cli, tmp_path: Path) -> None:
    """Foreign XML with its model is imported; the keys are those that it asks."""
    xml, tree = tmp_path / "my model.xml", tmp_path / "home.bt"
    xml.write_text(MODEL)
    assert islandgp("import", xml, "--vocabulary", xml, "-o", tree).code == 0
    assert (
        tree.read_text()
        == """subtree dock_it = Drive

selector {
  when charge < 25.5 and not docked abort self { use dock_it }
  sequence { IsTired Drive }
}
"""
    )
    assert islandgp("check", tree, "--vocabulary", xml).out.endswith("no warnings\n")
    assert "<ScriptCondition" in islandgp("export", tree, "--to", "btcpp", "--vocabulary", xml).out
    result = islandgp("check", "-", "--vocabulary", xml, stdin="selector { Driv }")
    assert (result.code, "Did you mean Drive?" in result.out) == (1, True)
    result = islandgp("check", "-", "--vocabulary", xml, stdin="when a { when a < 3 { Drive } }")
    assert (result.code, "a is a number" in result.out) == (1, True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected JSON of"),
        ("[]", "Expected a dictionary or an instance of Vocabulary for "),
        ('{"domain": "d"}', "Expected a value as actions of "),
        ('{"actions": {}}', "Expected a value as domain of "),
        ('{"domain": "a b", "actions": {}}', "found 'a b'"),
        (
            '{"domain": "d", "actions": {"A": {"statuses": ["DONE"]}}}',
            "Expected statuses among FAILURE, SUCCESS and RUNNING as actions.A.statuses of ",
        ),
        (
            '{"domain": "d", "actions": {"A": {"to_start": [["x", "~", 1]]}}}',
            "as actions.A.to_start.0 of ",
        ),
        (
            '{"domain": "d", "actions": {}, "keys": {"k": {"low": "1"}}}',
            "Expected a finite number as keys.k.low of ",
        ),
        (
            '{"domain": "d", "actions": {"A": {"meanin": "acts"}}}',
            "Expected no such field as actions.A.meanin of ",
        ),
        ('{"domain": "d", "actions": {}, "keys": {"k": {"low": NaN}}}', "expected JSON of"),
        ("<root/>", "expected a <TreeNodesModel> with actions"),
        ('<TreeNodesModel><Action ID="a b"/></TreeNodesModel>', "1:17: expected an ID of letters"),
        ("<root>", "not XML"),
    ],
)
def test_wrong_declarations(islandgp: Cli, tmp_path: Path, text: str, message: str) -> None:
    """What is wrong in a declaration is reported in a line."""
    file = tmp_path / "d"
    file.write_text(text)
    result = islandgp("simplify", "-", "--vocabulary", file, stdin="A")
    assert (result.code, result.out) == (2, "")
    assert message in result.err
    assert result.err.count("\n") == 1


def test_conditions_of_actions() -> None:
    """What an action needs is read from its conditions."""
    declaration = {**LIFT, "actions": {"Up": {"to_start": [["floor", "<", 8]]}}}
    vocabulary = declared(json.dumps(declaration), "", name="lift.json")
    assert vocabulary.action("Up").to_start == (Condition("floor", "<", 8.0),)


TWO_ACTIONS = "<TreeNodesModel><Action ID='Charge'/><Action ID='Patrol'/></TreeNodesModel>"


@pytest.mark.parametrize(
    "condition",
    ["battery < reserve", "battery <= 5 and a != b", "hot or not lap > 3", "mode == docking"],
)
@pytest.mark.parametrize("file", ["t.xml", "t.json"])
def test_exports_are_read_back_with_a_model(
    islandgp: Cli, tmp_path: Path, condition: str, file: str
) -> None:
    """A model declares no keys; those of an export are those of its conditions, on both sides."""
    tree, model, exported = tmp_path / "t.bt", tmp_path / "m.xml", tmp_path / file
    tree.write_text(f"reactive_selector {{ when {condition} abort self {{ Charge }} Patrol }}")
    model.write_text(TWO_ACTIONS)
    assert islandgp("export", tree, "--vocabulary", model, "-o", exported).code == 0
    result = islandgp("import", exported, "--vocabulary", model)
    assert (result.code, parse(result.out)) == (0, parse(tree.read_text())), result.err


def test_quoted_texts_are_not_keys() -> None:
    """The words in a text of a script are not read from the blackboard."""
    leaf = "<Charge _skipIf=\"mode == 'in dock' || !hot\"/>"
    tree = f"<BehaviorTree ID='T'><Sequence>{leaf}</Sequence></BehaviorTree>"
    xml = f"<root>{TWO_ACTIONS}{tree}</root>"
    vocabulary = declared(xml, xml, name="m.xml")
    assert {name: key.flag for name, key in vocabulary.keys.items()} == {"hot": True, "mode": False}


FLAG = """{"domain": "cart", "keys": {}, "actions": {
  "Stop": {"after": ["Go"]},
  "Go": {"arguments": {"fast": {
    "sort": "flag",
    "default": %s}}}
}}"""


@pytest.mark.parametrize(
    ("default", "value"), [('"no"', False), ("false", False), ('"yes"', True), ("true", True)]
)
def test_the_default_of_a_flag_is_no_or_yes(
    islandgp: Cli, tmp_path: Path, default: str, value: bool
) -> None:
    """Each accepted form works in `check`, in a bound tree and in both exports."""
    file, tree = tmp_path / "v.json", tmp_path / "t.bt"
    file.write_text(FLAG % default, encoding="utf-8")
    other = not value
    tree.write_text(
        f"sequence {{ Go(fast: {'yes' if other else 'no'}) Go Stop }}", encoding="utf-8"
    )
    assert islandgp("check", tree, "--vocabulary", file).code == 0
    seen: list[bool] = []

    def go(fast: bool) -> bool:
        seen.append(fast)
        return True

    vocabulary = declared(FLAG % default, "", name="v.json")
    bound = load_tree(tree, vocabulary).bind({"Go": go, "Stop": lambda: True}, {})
    bound.tick()
    assert seen == [other, value]
    xml = islandgp("export", tree, "--vocabulary", file, "--to", "btcpp").out
    assert f'fast="{str(other).lower()}"' in xml
    assert f'default="{str(value).lower()}"' in xml
    python = islandgp("export", tree, "--vocabulary", file, "--to", "pytrees").out
    assert f"action('Go', fast={other})" in python
    assert f"action('Go', fast={value})" in python


@pytest.mark.parametrize("default", ["1", "0"])
def test_another_default_of_a_flag_is_refused(default: str) -> None:
    """The message has the place, the value that was found and those that are expected."""
    with pytest.raises(DomainError) as refused:
        declared(FLAG % default, "", name="v.json")
    message = str(refused.value)
    assert message.startswith(
        "Expected a default of no | yes as actions.Go.arguments.fast of v.json,"
    )
    assert message.endswith(f", found {default}.")


def test_a_flag_has_the_words_no_and_yes() -> None:
    """A declaration in Python of another default or of other words is refused."""
    for wrong in (Parameter("", "flag", 1.0), Parameter("", "flag", "on", words=("off", "on"))):
        with pytest.raises(DomainError, match="use switch"):
            Vocabulary("cart", {"Go": Action("", arguments={"fast": wrong})}, {})
