"""Exported trees mean the same in the libraries they are written for, but for the stated losses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from islandgp.bt.core.format import format_text
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, walk
from islandgp.bt.core.parameters import one_of, real, switch, whole
from islandgp.bt.core.parameters import text as text_argument
from islandgp.bt.core.vocabulary import (
    Action,
    Vocabulary,
    condition_leaf,
    enumeration,
    flag,
    integer,
    number,
)
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.bt.export.json import from_json, to_json
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError, TreeError
from islandgp.resources import resource
from tests.profiles import examples
from tests.strategies import few_boards, few_numbers, nodes
from tests.trees.shell import Cli, CommandResult
from tests.trees.targets import main_tree

BOARDS = st.lists(few_boards(), min_size=2, max_size=14)
RESULTS = st.lists(st.sampled_from([FAILURE, SUCCESS, RUNNING, RUNNING]), min_size=1, max_size=40)
TREES = nodes(few_numbers(), max_leaves=10, max_repeats=3, timed=False, nav2=False)
FEW = examples(
    max_examples=300, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
)


ALL_KINDS = """
selector {
  sequence { always success GoTo(place: shelf, speed: 0.5) GoTo(place: "{goal}") }
  parallel success 2 failure all { A B() inverter { A } }
  when mode == docking and not (lap > 2 or hot) or a * 2 + b < lap { repeater 3 { A } }
  retry tries { force_success { force_failure { A } } }
  reactive_selector { reactive_sequence { wait delay { A } } timeout 2.5 { A } }
  cooldown 1 { pipeline { random_selector { A } round_robin { B } } }
  if_else { A B set mode = docking }
  recovery tries { every delay { A } until_failure { until_success { A } } }
  set hot = yes
  set lap = lap + 1
  when reply == "not given" abort none { A }
}"""
ALL_WORDS = Vocabulary(
    "robot",
    {
        **{name: Action("") for name in "AB"},
        "GoTo": Action("", arguments={"place": text_argument(""), "speed": real("", 0, 1)}),
    },
    {
        "mode": enumeration("", ["idle", "docking"], initial="idle"),
        "reply": enumeration("", ["given", "not given"]),
        "hot": flag("", initial="no"),
        "goal": enumeration("", ["shelf", "dock"]),
        **{name: number("", 0, 10) for name in ("a", "b", "delay")},
        **{name: integer("", 0, 10, initial=0) for name in ("lap", "tries")},
    },
)
SHIPPED = sorted((resource("grammar") / "examples").glob("*.bt"))
PATTERNS = sorted(Path(__file__).parents[2].glob("examples/patterns/*.bt"))


@examples(max_examples=100)
@given(tree=nodes(pairs=True))
def test_json_is_lossless(tree: Node) -> None:
    """Every tree of the language comes back from JSON as it was."""
    assert from_json(to_json(tree)) == tree


def test_every_kind_comes_back_from_json() -> None:
    """So do all kinds of nodes with all kinds of arguments, with a vocabulary and without one."""
    tree = parse(ALL_KINDS)
    assert {node.kind for node in walk(tree)} == KINDS.keys()
    assert from_json(to_json(tree)) == tree
    tree = parse(ALL_KINDS, ALL_WORDS)
    assert from_json(to_json(tree), ALL_WORDS) == tree
    assert all(f'"other": "{word}"' in to_json(tree) for word in ("yes", "docking"))


@pytest.mark.parametrize("file", [*SHIPPED, *PATTERNS], ids=lambda file: file.stem)
def test_shipped_trees_come_back_from_json(islandgp: Cli, tmp_path: Path, file: Path) -> None:
    """`export` and `import` of each example give an equal tree, words and flags included."""
    robot, vocabulary = [], VOCABULARY
    if file in PATTERNS:
        words = file.parent / "robot.json"
        robot, vocabulary = ["--vocabulary", words], declared(words.read_text(), "", name="robot")
    target = tmp_path / "a tree.json"
    exported = islandgp("export", file, *robot, "-o", target)
    assert exported == CommandResult(0, "", f"wrote {target}\n")
    result = islandgp("import", target, *robot)
    read, written = (parse(text, vocabulary) for text in (result.out, file.read_text()))
    assert (result.code, read) == (0, written)


WRONG_XML = {
    "<root": "not XML",
    "<tree/>": "expected <root ",
    '<root BTCPP_format="5"><BehaviorTree ID="A"/></root>': 'BTCPP_format="4"',
    "<!DOCTYPE a [<!ENTITY b 'c'>]><root/>": "no document type",
}
WRONG_NODES = {
    "<Sequence/>": "expected children",
    "<Sequenc><SeekCharger/></Sequenc>": "did you mean Sequence?",
    "<Delay delay_msec='{x}'><SeekCharger/></Delay>": "expected delay_msec from 1",
    "<RunOnce><SeekCharger/></RunOnce>": "no node",
    "<SetBlackboard value='1' output_key='x'/>": "unknown key with an `initial` value 'x'",
    "<Script code='lap := 1'/>": "unknown key with an `initial` value",
    "<Script code='lap'/>": "expected key := value",
    "<UnsetBlackboard key='lap'/>": "no node 'UnsetBlackboard'",
    "<Sequence><ScriptCondition code='lap + 1'/><SeekCharger/></Sequence>": "must be compared",
    "<Sequence><ScriptCondition code='!lap == 1'/><SeekCharger/></Sequence>": "such as level",
    "<Sequence><ScriptCondition code='(lap == 1'/><SeekCharger/></Sequence>": "such as level",
    "<Sequence><ScriptCondition code='lap &lt; 1||'/><SeekCharger/></Sequence>": "such as level",
    f"<Sequence><ScriptCondition code='{'(' * 99}lap'/><SeekCharger/></Sequence>": "such as level",
    "<Sequence><ScriptCondition code='lapp &lt; 1'/><SeekCharger/></Sequence>": "Did you mean lap",
    "<Sequence><ScriptCondition code='lap'/><SeekCharger/></Sequence>": "lap is a number",
    "<Parallel success_count='4'><SeekCharger/><SeekCharger/><SeekCharger/></Parallel>": "1 to 3",
    "<SeekCharger _skipIf='lap == 1'/>": "'_skipIf'",
    "<SubTree ID='Robot'/>": "contains itself",
    "<SubTree ID='Other'/>": "there is no <BehaviorTree ID='Other'>",
}


@pytest.mark.parametrize(
    ("node", "tree"),
    {
        "<ReactiveFallback><SeekCharger/><PatrolWaypoint/></ReactiveFallback>": (
            "reactive_selector { SeekCharger PatrolWaypoint }"
        ),
        "<Timeout msec='2500'><SeekCharger/></Timeout>": "timeout 2.5 { SeekCharger }",
        "<Delay delay_msec='500'><SeekCharger/></Delay>": "wait 0.5 { SeekCharger }",
        "<Parallel success_count='-2'><SeekCharger/><SeekCharger/><SeekCharger/></Parallel>": (
            "parallel success 2 { SeekCharger SeekCharger SeekCharger }"
        ),
    }.items(),
)
def test_nodes_of_the_library(node: str, tree: str) -> None:
    """Nodes that the language has by other names are read."""
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Robot">{node}</BehaviorTree></root>'
    assert to_text(main_tree(text, VOCABULARY)) == f"{tree}\n"


ROBOT = Vocabulary(
    "robot",
    {
        "IsPathClear": condition_leaf("the way is clear", {"to": one_of("", ("dock", "door"))}),
        "MoveTo": Action("", arguments={"speed": real("", 0, 1), "fast": switch("")}),
    },
    {},
)


def test_ports_are_arguments() -> None:
    """Conditions and arguments go out with the model's types, and come back."""
    tree = parse("sequence { IsPathClear(to: door) MoveTo(speed: 0.8, fast: yes) }", ROBOT)
    xml = behaviortree_cpp.to_xml(tree, ROBOT)
    assert '<MoveTo speed="0.8" fast="true"/>' in xml
    assert '<Condition ID="IsPathClear">' in xml
    assert main_tree(xml, ROBOT) == tree
    with pytest.raises(TreeError, match="expected speed of 0 to 1, found"):
        main_tree(xml.replace("0.8", "{speed}"), ROBOT)
    vocabulary = declared(xml, "MoveTo", name="model")
    assert [*vocabulary.action("MoveTo").arguments] == ["speed", "fast"]
    assert vocabulary.action("IsPathClear").condition


NOTED = """<!-- The day
     of a robot -->
<root BTCPP_format="4" main_tree_to_execute="Day">
  <!-- the whole day -->
  <BehaviorTree ID="Day" _description="until night">
    <Fallback name="choose" _fullpath="a/b">
      <!-- first the battery -->
      <SubTree ID="Recharge" name="charge" _autoremap="true"/>
      <Sequence name="collect">
        <ScriptCondition code="foundGarbage" name="garbage?"/>
        <!-- drive --> <Action ID="MoveToGarbage" name="go"/>
        <PickupGarbage name="PickupGarbage"/>
      </Sequence>
      <PatrolWaypoint _uid="7" _description="a &#10; &lt;b&gt; &quot;"/>
    </Fallback>
  </BehaviorTree>
  <BehaviorTree ID="Recharge"><ExecuteCharge name="low"/></BehaviorTree>
</root>"""


def test_comments_and_names_come_back() -> None:
    """An import writes them above their nodes, and so does an export."""
    text = read_tree(NOTED, VOCABULARY).text
    assert text == (
        """# name: low
subtree Recharge = ExecuteCharge

# The day
# of a robot
# the whole day
# _description: until night
# name: choose
# _fullpath: a/b
selector {
  # first the battery
  # name: charge
  use Recharge
  # name: collect
  # name: garbage?
  when foundGarbage abort none {
    sequence {
      # drive
      # name: go
      MoveToGarbage
      PickupGarbage
    }
  }
  # _description: a <b> "
  # _uid: 7
  PatrolWaypoint
}
"""
    )
    assert format_text(text) == text
    xml = to_xml(parse(text, VOCABULARY, marked=True), VOCABULARY)
    assert "<!-- drive -->" in xml
    assert "<!-- name: collect -->" in xml
    imported = read_tree(xml, VOCABULARY)
    assert to_xml(parse(imported.text, VOCABULARY, marked=True), VOCABULARY) == xml
    assert imported.tree == parse(text, VOCABULARY)


def test_comments_of_exported_files() -> None:
    """Those above a node and at the end of its line; odd ones make no broken XML."""
    text = """
    # above
    sequence {  # behind
      # a -- b --- \x01 <c> -->
      PatrolWaypoint  # patrol
      SeekCharger ExecuteCharge  # of the line's last node
    }
    # after the tree
    """
    xml = to_xml(parse(text, VOCABULARY, marked=True), VOCABULARY)
    tree = read_tree(xml, VOCABULARY)
    assert tree.tree == parse(text, VOCABULARY)
    assert tree.text.splitlines() == [
        "# above",
        "# behind",
        "sequence {",
        "  # a - - b - - -  <c> - ->",
        "  # patrol",
        "  PatrolWaypoint",
        "  SeekCharger",
        "  # of the line's last node",
        "  ExecuteCharge",
        "}",
    ]


def test_seconds() -> None:
    """The program says the seconds between two ticks; no library has a node for a cooldown."""
    tree = parse("timeout 2 { SeekCharger }")
    assert '<TimeoutTicks seconds="2">' in behaviortree_cpp.to_xml(tree)
    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree), module)
    with pytest.raises(ValueError, match="the seconds of a tick"):
        module["create_tree"](module["Success"])
    assert module["create_tree"](module["Success"], step_s=0.2).ticks == 10
    for write in (behaviortree_cpp.to_xml, py_trees.to_python):
        with pytest.raises(DomainError, match=r"without cooldown.* run it in Python"):
            write(parse("cooldown 2 { SeekCharger }"))


@pytest.mark.parametrize("text", [*WRONG_XML, *WRONG_NODES])
def test_wrong_xml(text: str) -> None:
    """XML that is no such tree is refused with its place and a reason."""
    message = WRONG_XML.get(text) or WRONG_NODES[text]
    if text in WRONG_NODES:
        text = f'<root BTCPP_format="4">\n<BehaviorTree ID="Robot">\n{text}</BehaviorTree></root>'
    with pytest.raises(TreeError) as excinfo:
        main_tree(text, VOCABULARY, name="t.xml")
    assert message in str(excinfo.value)
    if "Robot" in text:
        assert str(excinfo.value).startswith("t.xml:3:")


def test_foreign_xml() -> None:
    """Files as Groot writes them: explicit forms, subtrees, several conditions, names."""
    tree = main_tree(
        """<?xml version="1.0"?>
        <root BTCPP_format="4" main_tree_to_execute="Main">
          <BehaviorTree ID="Main">
            <Control ID="Fallback" name="root">
              <SubTree ID="Work" name="work"/>
              <Action ID="PatrolWaypoint" name="go on"/>
            </Control>
          </BehaviorTree>
          <BehaviorTree ID="Work">
            <Sequence>
              <ScriptCondition code="foundGarbage == true &amp;&amp; batteryLevel &gt;= 20"/>
              <MoveToGarbage/>
              <PickupGarbage/>
            </Sequence>
          </BehaviorTree>
        </root>""",
        VOCABULARY,
    )
    assert tree == parse(
        "selector { when foundGarbage and batteryLevel >= 20 abort none"
        " { sequence { MoveToGarbage PickupGarbage } } PatrolWaypoint }"
    )


CHILD = '"children": [{"kind": "action", "args": {"name": "SeekCharger"}}]'
SUM = '{"key": "lap+1", "operator": "<", "number": 3}'
WRONG_JSON = {
    "": "expected JSON or BehaviorTree.CPP XML, found another format",
    "\ufeff \n": "expected JSON or BehaviorTree.CPP XML, found another format",
    "{": "found: Expecting property name enclosed in double quotes: line 1 column 2",
    '{"format": "islandgp-tree", "tree": ' + "[" * 100_000: "it is nested too deeply",
    "[" + "1, " * 100_000 + "1]": "the file: namedTuple should have at",
    "[]": "field required, found []",
    '{"format": "tree", "tree": 1}': "format: input should be 'islandgp-tree', found 'tree'",
    '{"format": "islandgp-tree"}': "tree: field required",
    '{"kind": "selectr"}': "expected JSON of a tree, found: 'selectr'",
    '{"kind": "selector", "children": []}': "t.json, as text:1:9: the text ends too early",
    f'{{"kind": "selector", "args": {{"x": 1}}, {CHILD}}}': "tree.args: ",
    '{"kind": "use", "args": {"head": "use x"}}': "unknown subtree 'x'",
    '{"kind": "always", "args": {"head": "SeekCharger"}}': "writes in another way",
    '{"kind": "action", "args": {"name": "Dance"}}': "unknown action 'Dance'",
    '{"kind": "action", "args": {"name": "a b"}}': "unexpected 'b'",
    '{"kind": "action"}': "expected JSON of a tree",
    '{"kind": "when", "args": {"condition": 1}}': "tree.args: ",
    f'{{"kind": "when", "args": {{"condition": {SUM}}}, {CHILD}}}': "writes in another way",
    f'{{"kind": "repeater", "args": {{"times": 1e300}}, {CHILD}}}': "is out of range",
    f'{{"kind": "repeater", "args": {{"times": 0}}, {CHILD}}}': "a whole number from 1 to",
    f'{{"kind": "repeater", "args": {{"times": 1e999}}, {CHILD}}}': "1e999 is no number",
    '{"kind": "action", "args": {"name": "SeekCharger", "speed": 3}}': "tree.args: ",
    '{"kind": "inverter", "children": [3]}': "tree.children.0: input should be",
    '{"kind": "inverter", "children": [' * 300 + "3" + "]}" * 300: "tree.children.0",
}


@pytest.mark.parametrize("text", WRONG_JSON, ids=lambda text: text[:60])
def test_wrong_json(islandgp: Cli, tmp_path: Path, text: str) -> None:
    """JSON that is no such tree is refused with its place and a reason, and nothing is written."""
    document = f'{{"format": "islandgp-tree", "tree": {text}}}' if "kind" in text else text
    (tmp_path / "t.json").write_text(document, encoding="utf-8")
    result = islandgp("import", tmp_path / "t.json", "-o", tmp_path / "t.bt")
    assert (result.code, result.out, (tmp_path / "t.bt").exists()) == (2, "", False)
    assert WRONG_JSON[text] in result.err
    assert "t.json" in result.err.splitlines()[0]
    assert len(result.err) < 1000


def test_hostile_files() -> None:
    """A hundred nested levels are read, a hundred thousand are an error like any other."""
    deep = parse("inverter { " * 99 + "always running" + "}" * 99)
    assert from_json(to_json(deep)) == deep
    with pytest.raises(TreeError):
        main_tree("<Sequence>" * 100_000, VOCABULARY)


def test_commands(islandgp: Cli, tmp_path: Path) -> None:
    """export chooses the form by the ending, says what it needs; import reads both forms back."""
    example = resource("grammar") / "examples" / "all_rounder.bt"
    for name in ("t.json", "t.XML", "t.py"):
        result = islandgp("export", example, "-o", tmp_path / name)
        assert result.code == 0
        assert ("needs islandgp_nodes.hpp" in result.err) == (name == "t.XML")
    (tmp_path / "n.bt").write_text("pipeline { every 1 { SeekCharger } PatrolWaypoint }")
    result = islandgp("export", tmp_path / "n.bt", "--to", "btcpp")
    assert "needs Nav2's PipelineSequence, RateController, which measures" in result.err
    assert "class When" in islandgp("export", "--header").out
    for arguments in ([example], ["--to", "btcpp"]):
        assert "expected --header alone" in islandgp("export", "--header", *arguments).err
    for name in ("t.json", "t.XML"):
        result = islandgp("import", tmp_path / name)
        assert parse(result.out) == parse(example.read_text())
    assert "expected JSON or BehaviorTree.CPP XML" in islandgp("import", tmp_path / "n.bt").err
    refused = islandgp("import", tmp_path / "t.json", "--tree", "T").err
    assert "expected BehaviorTree.CPP XML with --tree" in refused
    assert islandgp("export", example).code == 2


BOT = Vocabulary(
    "bot",
    {"Dock": Action("docks"), "Drive": Action("drives")},
    {
        "mode": enumeration("what it does", ("idle", "docking")),
        "before": enumeration("what it did", ("idle", "docking")),
        "charge": number("%", 0, 100),
        "reserve": number("%", 0, 100),
    },
)


@pytest.mark.parametrize(
    "condition", ["mode == docking", "mode != before and charge < reserve", "charge < reserve"]
)
@pytest.mark.parametrize("abort", ["none", "self"])
@pytest.mark.parametrize("charge", [5.0, 50.0])
def test_words_and_two_keys_in_both_libraries(condition: str, abort: str, charge: float) -> None:
    """The libraries compare texts with words, and entries with entries."""
    library: Any = pytest.importorskip("py_trees")
    tree = parse(f"selector {{ when {condition} abort {abort} {{ Dock }} Drive }}", BOT)
    mode = "docking" if charge < 10 else "idle"
    board = {"mode": mode, "before": "idle", "charge": charge, "reserve": 9.0}
    called: list[str] = []

    class Called(library.behaviour.Behaviour):  # type: ignore[misc]  # it has no types
        def update(self) -> object:
            called.append(self.name)
            return library.common.Status.SUCCESS

    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree, BOT), module)
    library.blackboard.Blackboard.clear()
    for name, value in board.items():
        library.blackboard.Blackboard.set(name, value)
    module["create_tree"](Called).tick_once()
    expected = ["Dock" if charge < 10 else "Drive"]
    assert called == expected
    called.clear()
    if "When" not in (xml := behaviortree_cpp.to_xml(tree, BOT)):
        _tick_in_cpp(xml, board, called)
        assert called == expected


def _tick_in_cpp(xml: str, board: Mapping[str, str | float], called: list[str]) -> None:
    """Ticks a file without our nodes once in BehaviorTree.CPP; its actions succeed."""
    cpp: Any = pytest.importorskip("behaviortreepy")
    factory, blackboard = cpp.BehaviorTreeFactory(), cpp.Blackboard.create()
    for name in BOT.actions:
        factory.register_simple_action(
            name, lambda _, name=name: called.append(name) or cpp.NodeStatus.SUCCESS
        )
    for name, value in board.items():
        kind = "string" if isinstance(value, str) else "double"
        getattr(blackboard, f"set_{kind}")(name, value)
    factory.register_behavior_tree_from_text(xml)
    factory.create_tree("Robot", blackboard).tick_once()


CALLED = Vocabulary(
    "arm",
    {
        "Move": Action(
            "",
            arguments={
                "goal": one_of("", ("dock", "door")),
                "times": whole("", 1, 9, default=2),
                "fast": switch(""),
                "from": real("", 0, 1),
                "note": text_argument("", "hello"),
            },
        )
    },
    {"mode": enumeration("what it does", ("idle", "docking"))},
)


@pytest.mark.parametrize(
    ("leaf", "changes"),
    [
        ("Move", {}),
        ("Move(fast: yes, times: 3)", {"fast": True, "times": 3}),
        ('Move(from: 0.25, note: "\\x {0}")', {"from": 0.25, "note": "\\x {0}"}),
    ],
)
def test_py_trees_calls_actions_as_a_bound_tree_does(leaf: str, changes: dict[str, Any]) -> None:
    """With all arguments: flags as True or False, whole numbers as int, texts as they are."""
    pytest.importorskip("py_trees")
    text = py_trees.to_python(parse(f"when mode == idle {{ {leaf} }}", CALLED), CALLED)
    assert "mode: what it does; one of idle, docking" in text
    module: dict[str, Any] = {}
    exec(text, module)
    calls: list[dict[str, Any]] = []

    def action(name: str, **arguments: object) -> Any:
        calls.append({"name": name, **arguments})
        return module["Sequence"](name, memory=True)

    module["create_tree"](action)
    defaults = {"goal": "dock", "times": 2, "fast": False, "from": 0.5, "note": "hello"}
    assert calls == [{"name": "Move", **defaults, **changes}]
    assert [*map(type, calls[0].values())] == [str, str, int, bool, float, str]


@pytest.mark.parametrize("name", ["name", "ID", "_skipIf"])
def test_ports_have_names_that_the_library_accepts(name: str) -> None:
    """A node's name, its ID and conditions of the library are no ports."""
    vocabulary = Vocabulary("arm", {"Move": Action("", arguments={name: real("", 0, 1)})}, {})
    with pytest.raises(DomainError, match=f"neither name nor ID, found '{name}' of the action"):
        behaviortree_cpp.to_xml(parse("Move", vocabulary), vocabulary)
