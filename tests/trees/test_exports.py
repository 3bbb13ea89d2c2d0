"""Exported trees mean the same in the libraries they are written for, but for the stated losses."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given
from hypothesis import strategies as st

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, walk
from islandgp.bt.core.parameters import one_of, real, switch, whole
from islandgp.bt.core.parameters import text as text_argument
from islandgp.bt.core.vocabulary import Action, Vocabulary, condition_leaf, enumeration, number
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.bt.export.json import from_json, to_json
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError, TreeError
from islandgp.resources import resource
from islandgp.viewer.recording import FAILED, SUCCEEDED
from tests.bt.stage import short_tree
from tests.composed import composed
from tests.profiles import cases, examples, sweep
from tests.strategies import few_boards, few_numbers, nodes
from tests.trees.shell import Cli
from tests.trees.targets import leaves, main_tree, with_unique_names
from tests.trees.worlds import random_trees
from tests.viewer.episodes import recorded

BOARDS = st.lists(few_boards(), min_size=2, max_size=14)
RESULTS = st.lists(st.sampled_from([FAILURE, SUCCESS, RUNNING, RUNNING]), min_size=1, max_size=40)
TREES = nodes(few_numbers(), max_leaves=10, max_repeats=3, timed=False, nav2=False)
FEW = examples(
    max_examples=300, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
)

Call = tuple[str, bool]  # (leaf, fresh)
Trace = list[tuple[list[Call], str]]  # per tick the calls, and the root's status


class Script:
    """What leaves return, one result after the other, and who called."""

    def __init__(self, results: list[int]) -> None:
        self.calls: list[Call] = []
        self._results = results
        self._taken = 0

    def call(self, name: str, fresh: bool) -> int:
        self.calls.append((name, fresh))
        self._taken += 1
        return self._results[(self._taken - 1) % len(self._results)]

    def take(self) -> list[Call]:
        calls, self.calls = self.calls, []
        return calls


def ours(tree: Node, boards: list[list[float]], results: list[int]) -> Trace:
    script, board = Script(results), list(boards[0])

    def action(name: str) -> Callable[[bool], int]:
        return lambda fresh: script.call(name, fresh)

    tick = compile_tree(
        tree,
        {name: action(name) for name in leaves(tree)},
        board,
        VOCABULARY.key_index,
        step_s=1.0,
    )
    trace: Trace = []
    for values in boards:
        board[:] = values
        status = ("FAILURE", "SUCCESS", "RUNNING", "RUNNING")[tick()]
        trace.append((script.take(), status))
    return trace


def in_behaviortree_cpp(tree: Node, boards: list[list[float]], results: list[int]) -> Trace:
    """The same in the real library, from the exported XML."""
    cpp: Any = pytest.importorskip("behaviortreepy", reason="extra `btcpp` is not installed")
    script = Script(results)
    statuses = (cpp.NodeStatus.FAILURE, cpp.NodeStatus.SUCCESS, cpp.NodeStatus.RUNNING)
    factory = cpp.BehaviorTreeFactory()
    for name in leaves(tree):
        factory.register_simple_stateful_action(
            name,
            lambda _, name=name: statuses[script.call(name, True)],
            lambda _, name=name: statuses[script.call(name, False)],
        )
    cpp_tree = factory.create_tree_from_text(behaviortree_cpp.to_xml(tree, VOCABULARY, plain=True))
    board = cpp_tree.root_blackboard()
    trace: Trace = []
    for values in boards:
        for (name, key), value in zip(VOCABULARY.keys.items(), values, strict=True):
            (board.set_bool if key.flag else board.set_double)(name, value)
        status = cpp_tree.tick_exactly_once().name
        trace.append((script.take(), status))
    return trace


def in_py_trees(tree: Node, boards: list[list[float]], results: list[int]) -> Trace:
    """The same in the real library, from the exported module."""
    library: Any = pytest.importorskip("py_trees", reason="extra `pytrees` is not installed")
    script = Script(results)
    names = library.common.Status
    statuses = (names.FAILURE, names.SUCCESS, names.RUNNING)

    class Leaf(library.behaviour.Behaviour):  # type: ignore[misc]
        fresh = True

        def initialise(self) -> None:
            self.fresh = True

        def update(self) -> Any:
            fresh, self.fresh = self.fresh, False
            return statuses[script.call(self.name, fresh)]

    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree, VOCABULARY, plain=True), module)
    library.blackboard.Blackboard.clear()
    root = module["create_tree"](Leaf)
    writer = library.blackboard.Client(name="robot")
    for name in VOCABULARY.keys:
        writer.register_key(name, access=library.common.Access.WRITE)
    trace: Trace = []
    for values in boards:
        for name, value in zip(VOCABULARY.keys, values, strict=True):
            writer.set(name, value)
        root.tick_once()
        trace.append((script.take(), root.status.name))
    return trace


@FEW
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_behaviortree_cpp_means_the_same(
    tree: Node, boards: list[list[float]], results: list[int]
) -> None:
    """A tree without stated losses makes the same calls in BehaviorTree.CPP, tick by tick."""
    tree = with_unique_names(tree, iter(range(100)))
    assume(not behaviortree_cpp.losses(tree))
    assert in_behaviortree_cpp(tree, boards, results) == ours(tree, boards, results)


@FEW
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_py_trees_means_the_same(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """A tree without stated losses makes the same calls in py_trees, tick by tick."""
    tree = with_unique_names(tree, iter(range(100)))
    assume(not py_trees.losses(tree))
    assert in_py_trees(tree, boards, results) == ours(tree, boards, results)


# Each stated loss, shown: the tree, its boards (p: foundGarbage), what its leaves return one after
# the other, and what is called in which tick, here and there.
LOSSES = {
    "level": (
        "selector { when p { A } B }",
        ["p", "p", "p"],
        "FRRRRR",
        ["A! B!", "B", "B"],
        ["A! B!", "A!", "A"],
    ),
    "inner": (
        "selector { when p { when q abort none { A } } B }",
        ["p", "p", "pq"],
        "RRRRRR",
        ["B!", "B", "B"],
        ["B!", "B", "A!"],
    ),
    "dropped": (
        "sequence { when p { A } B }",
        ["p", "", "p"],
        "SRRRRR",
        ["A! B!", "B", "A!"],
        ["A! B!", "B", "B"],
    ),
    "repeat": ("repeater 2 { A }", ["", "", ""], "RSRRR", ["A!", "A", "A!"], ["A!", "A A!", "A"]),
    "judged": ("parallel { A B }", ["", ""], "FRFR", ["A! B!", "A! B!"], ["A!", "A! B!"]),
    "policy": (
        "parallel failure all { A B }",
        ["", ""],
        "FRRRRR",
        ["A! B!", "B"],
        ["A!", "A! B!"],
    ),
}


def short_trace(trace: Trace, names: dict[str, str]) -> list[str]:
    """Calls as text: a letter each, with a mark for a fresh start."""
    return [" ".join(names[name] + "!" * fresh for name, fresh in calls) for calls, status in trace]


@pytest.mark.parametrize("about", LOSSES)
def test_stated_losses_are_real(about: str) -> None:
    """Each loss is stated for its tree, and BehaviorTree.CPP does what the loss describes."""
    text, flags, letters, ours_expected, theirs_expected = LOSSES[about]
    tree = short_tree(text)
    assert about in [loss.about for loss in behaviortree_cpp.losses(tree)]
    boards = [
        [0.0, 0.0, 0.0, float("p" in true_flags), float("q" in true_flags)] for true_flags in flags
    ]
    results = ["FSR".index(letter) for letter in letters]
    names = dict(zip(VOCABULARY.actions, "ABCDEFG", strict=True))
    assert short_trace(ours(tree, boards, results), names) == ours_expected
    assert short_trace(in_behaviortree_cpp(tree, boards, results), names) == theirs_expected


def test_random_trees() -> None:
    """Random trees: JSON gives the tree back, the XML loads in the real library, and what is read
    from it is the same when it is written and read again."""
    cpp: Any = pytest.importorskip("behaviortreepy", reason="extra `btcpp` is not installed")
    factory = cpp.BehaviorTreeFactory()
    for name in VOCABULARY.actions:
        factory.register_simple_action(name, lambda _: cpp.NodeStatus.SUCCESS)
    for tree in random_trees(composed(), cases(500)):
        assert from_json(to_json(tree)) == tree
        xml = behaviortree_cpp.to_xml(tree, VOCABULARY, plain=True)
        cpp_tree = factory.create_tree_from_text(xml)
        board = cpp_tree.root_blackboard()
        for name, key in VOCABULARY.keys.items():
            (board.set_bool if key.flag else board.set_double)(name, 1)
        cpp_tree.tick_exactly_once()
        imported = main_tree(xml, VOCABULARY)
        exported = behaviortree_cpp.to_xml(imported, VOCABULARY, plain=True)
        assert main_tree(exported, VOCABULARY) == imported


@FEW
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_import_of_an_export_does_the_same(
    tree: Node, boards: list[list[float]], results: list[int]
) -> None:
    """What comes back from XML does what the tree did, where no guard was lost on the way."""
    stated = {loss.about for loss in behaviortree_cpp.losses(tree)}
    assume(not stated - {"repeat", "judged", "equal"})
    imported = main_tree(behaviortree_cpp.to_xml(tree, VOCABULARY, plain=True), VOCABULARY)
    assert ours(imported, boards, results) == ours(tree, boards, results)


@examples(max_examples=200)
@given(tree=nodes())
def test_json_is_lossless(tree: Node) -> None:
    """Every tree of the language comes back from JSON as it was."""
    assert from_json(to_json(tree)) == tree


EXAMPLES = sorted(path.stem for path in (resource("grammar") / "examples").glob("*.bt"))
QUICK = ("all_rounder", "diverse_compact")  # equal in both forms, and in one
PARTLY = {  # % of the ticks
    "diverse": 93.8,
    "diverse_compact": 32.9,
    "paper_fig9": 95.4,
    "single_clearing": 78.5,
    "single_humanoid": 90.3,
    "single_pickup": 64.5,
}


@pytest.mark.slow
@sweep(
    "name",
    [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in EXAMPLES],
    quick=1,
)
def test_py_trees_decides_the_same_on_a_recorded_episode(name: str) -> None:
    """On the blackboard and the results of an episode, py_trees calls the same actions each tick.

    These examples have interrupting guards, so a plain module has a stated loss; where it shows,
    docs/exports.md has the share.
    """
    assert agreement(name, plain=False) == 100
    assert agreement(name, plain=True) == pytest.approx(PARTLY.get(name, 100), abs=0.05)
    page = (resource("conf").parent / "docs" / "exports.md").read_text(encoding="utf-8")
    for partly, share in PARTLY.items():
        assert re.search(rf"{share} %\s+(of the ticks )?for\s+{partly}", page), partly


def agreement(name: str, *, plain: bool) -> float:
    """The share of an episode's ticks in which py_trees calls the same leaves, in percent."""
    library: Any = pytest.importorskip("py_trees", reason="extra `pytrees` is not installed")
    recording = recorded(name)
    tree = with_unique_names(recording.tree, iter(range(100)))  # an action may be in several places
    place = {node.action: place for place, node in enumerate(walk(tree)) if node.action}
    statuses = library.common.Status
    theirs = {FAILURE: statuses.FAILURE, SUCCESS: statuses.SUCCESS, RUNNING: statuses.RUNNING}
    now = same = 0
    called: list[str] = []

    def result(leaf: str) -> int:
        """What a leaf returned in this tick; RUNNING also where it was stopped behind its call."""
        called.append(leaf)
        ended = {FAILED: FAILURE, SUCCEEDED: SUCCESS}
        return ended.get(recording.statuses[place[leaf]][now], RUNNING)

    class Leaf(library.behaviour.Behaviour):  # type: ignore[misc]
        def update(self) -> Any:
            return theirs[result(self.name)]

    board = [0.0] * len(VOCABULARY.keys)
    actions = {leaf: lambda _, leaf=leaf: result(leaf) for leaf in place}
    tick = compile_tree(tree, actions, board, VOCABULARY.key_index)
    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree, VOCABULARY, plain=plain), module)
    library.blackboard.Blackboard.clear()
    root = module["create_tree"](Leaf)
    writer = library.blackboard.Client(name="robot")
    for key in VOCABULARY.keys:
        writer.register_key(key, access=library.common.Access.WRITE)
    for now, values in enumerate(recording.boards):  # noqa: B007 -- `result` reads it
        board[:] = values
        tick()
        own_calls, called = called, []
        for key, value in zip(VOCABULARY.keys, values, strict=True):
            writer.set(key, value)
        root.tick_once()
        same += called == own_calls
        called = []
    return 100 * same / recording.ticks


WRONG_XML = {
    "<root": "not XML",
    "<tree/>": "expected <root>",
    '<root BTCPP_format="5"><BehaviorTree ID="A"/></root>': 'BTCPP_format="4"',
    "<!DOCTYPE a [<!ENTITY b 'c'>]><root/>": "no document type",
}
WRONG_NODES = {
    "<Sequence/>": "expected children",
    "<Sequenc><SeekCharger/></Sequenc>": "did you mean Sequence?",
    "<Delay delay_msec='{x}'><SeekCharger/></Delay>": "expected delay_msec from 1",
    "<RunOnce><SeekCharger/></RunOnce>": "no node",
    "<SetBlackboard value='1' output_key='x'/>": "unknown blackboard key 'x'",
    "<Script code='lap := 1'/>": "only the domain writes",
    "<Script code='lap'/>": "expected key := value",
    "<UnsetBlackboard key='lap'/>": "set another value",
    "<Sequence><ScriptCondition code='lap + 1'/><SeekCharger/></Sequence>": "must be compared",
    "<Sequence><ScriptCondition code='!lap == 1'/><SeekCharger/></Sequence>": "such as level",
    "<Sequence><ScriptCondition code='(lap == 1'/><SeekCharger/></Sequence>": "such as level",
    "<Sequence><ScriptCondition code='lap &lt; 1||'/><SeekCharger/></Sequence>": "such as level",
    f"<Sequence><ScriptCondition code='{'(' * 99}lap'/><SeekCharger/></Sequence>": "16 levels",
    "<Sequence><ScriptCondition code='lapp &lt; 1'/><SeekCharger/></Sequence>": "did you mean lap",
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
    """An import writes them above their nodes, an export where they were."""
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
    for part in (
        '<Fallback name="choose" _description="until night" _fullpath="a/b">',
        '<SubTree ID="Recharge" _autoremap="true" name="charge"/>',
        '<ScriptCondition code="foundGarbage" name="garbage?"/>',
        '<!-- drive -->\n          <MoveToGarbage name="go"/>',
        '<PatrolWaypoint _description=\'a &lt;b&gt; "\' _uid="7"/>',
    ):
        assert part in xml
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
      SeekCharger ExecuteCharge  # of the line's first node
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
        "  # of the line's first node",
        "  SeekCharger",
        "  ExecuteCharge",
        "}",
    ]


def test_more_comments_than_a_file_holds() -> None:
    """They are left out, and the tree is imported."""
    text = NOTED.replace("the whole day", "the whole day " * 10_000)
    imported = read_tree(text, VOCABULARY)
    assert "#" not in imported.text
    assert [each.loss.about for each in imported.differences] == ["comments"]


def test_seconds_need_a_step() -> None:
    """Our nodes count ticks, so an exact export needs the time between them."""
    tree = parse("timeout 2 { SeekCharger }")
    assert 'ticks="20" seconds="2"' in behaviortree_cpp.to_xml(tree, step_s=0.1)
    for write in (behaviortree_cpp.to_xml, py_trees.to_python):
        with pytest.raises(DomainError, match="--step"):
            write(tree)
    with pytest.raises(DomainError, match=r"without cooldown.*as Python \(--to pytrees"):
        behaviortree_cpp.to_xml(parse("cooldown 2 { SeekCharger }"), step_s=0.1)


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
    "{": "t.json:1:2: not JSON",
    "[]": "t.json: the file: Input should be a valid dictionary, found []",
    '{"format": "tree", "tree": 1}': "format: Input should be 'islandgp-tree', found 'tree'",
    '{"format": "islandgp-tree"}': "tree: Field required",
    '{"kind": "selectr"}': "tree.kind: Input should be 'selector', 'sequence', ",
    '{"kind": "selector", "children": []}': "t.json, as text:1:9: the text ends too early",
    f'{{"kind": "selector", "args": {{"x": 1}}, {CHILD}}}': "tree.args: Expected no args",
    '{"kind": "action", "args": {"name": "Dance"}}': "unknown action 'Dance'",
    '{"kind": "action", "args": {"name": "a b"}}': "unexpected 'b'",
    '{"kind": "action"}': "tree.args.name: Field required",
    '{"kind": "when", "args": {"condition": 1}}': "tree.args.condition",
    f'{{"kind": "when", "args": {{"condition": {{"word": "not", "parts": []}}}}, {CHILD}}}': "`not",
    f'{{"kind": "when", "args": {{"condition": {SUM}}}, {CHILD}}}': "sums as `islandgp fmt` writes",
    f'{{"kind": "repeater", "args": {{"times": 1e300}}, {CHILD}}}': "a repeater can't repeat",
    f'{{"kind": "repeater", "args": {{"times": 1e999}}, {CHILD}}}': "1e999 is no number",
    f'{{"kind": "repeater", "args": {{"times": true}}, {CHILD}}}': "tree.args.times: Input ",
    '{"kind": "action", "args": {"name": "SeekCharger", "speed": 3}}': "tree.args.speed: ",
    '{"kind": "inverter", "children": [3]}': "tree.children.0: Input should be",
}


@pytest.mark.parametrize("text", WRONG_JSON)
def test_wrong_json(text: str) -> None:
    """JSON that is no such tree is refused with its place and a reason."""
    document = f'{{"format": "islandgp-tree", "tree": {text}}}' if "kind" in text else text
    with pytest.raises(TreeError) as excinfo:
        from_json(document, VOCABULARY, name="t.json")
    assert WRONG_JSON[text] in str(excinfo.value)


def test_hostile_files() -> None:
    """A hundred nested levels are read, a hundred thousand are an error like any other."""
    deep = parse("inverter { " * 99 + "always running" + "}" * 99)
    assert from_json(to_json(deep)) == deep
    with pytest.raises(TreeError):
        main_tree("<Sequence>" * 100_000, VOCABULARY)
    with pytest.raises(TreeError):
        from_json('{"format": "islandgp-tree", "tree": ' + "[" * 100_000)


def test_commands(islandgp: Cli, tmp_path: Path) -> None:
    """export chooses the form by the ending and lists the losses; import reads both forms back."""
    example = resource("grammar") / "examples" / "all_rounder.bt"
    for name in ("t.json", "t.xml", "t.py"):
        result = islandgp("export", example, "-o", tmp_path / name)
        assert (result.code, "not the same" in result.err) == (0, False)
        assert ("needs islandgp_nodes.hpp" in result.err) == (name == "t.xml")
    for name in ("plain.json", "plain.XML", "plain.py"):
        result = islandgp("export", example, "--plain", "-o", tmp_path / name)
        assert result.code == 0
        assert result.err.startswith("not the same (level)") == (name != "plain.json")
    assert "class When" in islandgp("export", "--header").out
    for arguments in ([example], ["--to", "btcpp"]):
        assert "expected --header alone" in islandgp("export", "--header", *arguments).err
    for name in ("t.json", "t.xml"):
        result = islandgp("import", tmp_path / name)
        assert parse(result.out) == parse(example.read_text())
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
    _tick_in_cpp(behaviortree_cpp.to_xml(tree, BOT, plain=True), board, called)
    assert called == expected


def _tick_in_cpp(xml: str, board: Mapping[str, str | float], called: list[str]) -> None:
    """Ticks a plain file once in BehaviorTree.CPP; its actions succeed."""
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
