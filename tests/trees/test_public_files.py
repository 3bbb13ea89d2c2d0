"""Small files with what public files of BehaviorTree.CPP, Groot and MoveIt Pro have."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.errors import TreeError

MODEL = """<TreeNodesModel>
  <Action ID="Go"><input_port name="goal"/></Action>
  <Action ID="Say"><input_port name="text"/></Action>
  <Action ID="Sleep"><input_port name="sleep_time"/></Action>
  <Decorator ID="ForEach"><input_port name="vector_in"/><output_port name="out"/></Decorator>
  <Decorator ID="ForEachUntilSuccess"><input_port name="vector_in"/></Decorator>
  <SubTree ID="Open Gripper"><input_port name="width"/></SubTree>
</TreeNodesModel>"""
PLACE = """<root BTCPP_format="4"><BehaviorTree ID="Visit">
  <Sequence>
    <ScriptCondition code="tries &lt; 3"/><Go goal="{place}"/><Say text="{greeting}"/>
  </Sequence>
</BehaviorTree></root>"""

FILES = {
    '<SubTree ID="Visit" place="{target}" tries="{count}" greeting="good day"/>': (
        'when count < 3 abort none { sequence { Go(goal: "{target}") Say(text: "good day") } }',
        ""),
    '<SubTree ID="Visit" place="{=}" tries="1" _collapsed="true"/>': None,
    '<SubTree ID="Open Gripper" width="0.2"/>': ('Open_Gripper(width: "0.2")', "outside"),
    '<Sleep sleep_time="5.0"/>': ('Sleep(sleep_time: "5.0")', ""),
    '<Sequence><Go _onSuccess="n := n + 1" goal="a b"/><Say/></Sequence>': (
        'sequence { sequence { Go(goal: "a b") set n = n + 1 } Say }', ""),
    '<Go _onFailure="n = 0" _post="ok := true"/>': (
        "selector { sequence { selector { Go sequence { set n = 0 always failure } } set ok = yes }"
        " sequence { set ok = yes always failure } }", ""),
    '<Repeat num_cycles="{count}"><Go/></Repeat>': ("repeater count { Go }", "repeat"),
    '<BlackboardCheckString value_A="{reply}" value_B="not given" return_on_mismatch="FAILURE">'
    "<Go/></BlackboardCheckString>": ('when reply == "not given" abort self { Go }', "equal"),
    '<SetBlackboard output_key="reply" value="map;1;2"/>': ('set reply = "map;1;2"', ""),
    '<AsyncSequence><Go goal="{@top}"/><Say/></AsyncSequence>': (
        'sequence { Go(goal: "{top}") Say }', "async"),
    '<ForEach vector_in="{all}" out="{one}"><Go goal="{one}"/></ForEach>': (
        'recovery 1000000 { inverter { ForEach(vector_in: "{all}", out: "{one}") }'
        ' Go(goal: "{one}") }', "gate"),
    '<ForEachUntilSuccess vector_in="{all}"><Go/></ForEachUntilSuccess>': (
        'inverter { recovery 1000000 { inverter { ForEachUntilSuccess(vector_in: "{all}") }'
        " inverter { Go } } }", "gate"),
    '<Switch2 variable="{mode}" case_1="dock" case_2="b"><Go/><Say/><Go/></Switch2>': (
        "switch mode { dock { Go } b { Say } else { Go } }", "equal"),
    "<Sequence>first <Go/> then <Say/></Sequence>": ("sequence { Go Say }", ""),
}  # fmt: skip


@pytest.mark.parametrize("body", FILES)
def test_file(body: str, tmp_path: Path) -> None:
    """It is read, or refused with the reason, with what is not quite the same."""
    (tmp_path / "visit.xml").write_text(PLACE)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="M">{body}</BehaviorTree></root>'
    about = {"name": "m.xml", "folder": tmp_path}
    robot = declared(MODEL, text, name="model", tree_name="m.xml", folder=tmp_path)
    if FILES[body] is None:  # a number takes the place of a key
        with pytest.raises(TreeError, match=r"such as level|unexpected|a key"):
            read_tree(text, robot, **about)  # type: ignore[arg-type]
        return
    tree, differences = FILES[body]  # type: ignore[misc]
    imported = read_tree(text, robot, **about)  # type: ignore[arg-type]
    assert imported.tree == parse(tree, robot)
    assert " ".join(imported.differences) == differences


def test_entries_without_braces_in_version_3(tmp_path: Path) -> None:
    """A SubTree of version 3 passes names of entries; its SubTreePlus passes texts."""
    (tmp_path / "visit.xml").write_text(PLACE)
    for tag, goal in (("SubTree", '"{target}"'), ("SubTreePlus", "target")):
        text = (
            f'<root><BehaviorTree ID="M"><{tag} ID="Visit" place="target" tries="{{n}}"'
            ' greeting="{g}"/></BehaviorTree></root>'
        )
        robot = declared(MODEL, text, name="model", tree_name="m.xml", folder=tmp_path)
        imported = read_tree(text, robot, name="m.xml", folder=tmp_path)
        assert f"Go(goal: {goal})" in imported.text
