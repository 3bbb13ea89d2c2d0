"""Nav2's trees and the nodes that they need: what is read, what it means, what goes out again."""

from __future__ import annotations

import re
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, ActionArgs, Node, walk
from islandgp.bt.core.parameters import text
from islandgp.bt.core.vocabulary import Action, Vocabulary, condition_leaf, flag, number
from islandgp.bt.export import py_trees
from islandgp.bt.export.behaviortree_cpp import needs, to_xml
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import Imported, read_tree
from islandgp.errors import DomainError, TreeError
from tests.running.commands import ROOT
from tests.trees.nav2 import SHAPES, file_of
from tests.trees.targets import Script, Trace, ours

ROBOT = Vocabulary(
    "robot",
    {
        "Go": Action("goes", arguments={"goal": text("where to")}),
        "Stay": Action("stays"),
        "Clear": Action("clears"),
        "Free": condition_leaf("whether the way is free"),
    },
    {"low": flag("the battery is low"), "mode": number("what to do", 0, 9)},
)


def read(shape: str) -> Imported:
    xml = file_of(shape)
    return read_tree(xml, declared(xml, xml, name="model.xml"), name="tree.xml")


def inside(xml: str) -> Imported:
    """The tree of a file with that node."""
    return read_tree(f'<root><BehaviorTree ID="M">{xml}</BehaviorTree></root>', ROBOT)


def table_of(imported: Imported) -> str:
    return ", ".join(sorted(imported.differences))


@pytest.mark.parametrize("name", SHAPES)
def test_published_trees(name: str) -> None:
    """Each is read with its ports, with the differences that docs/exports.md lists."""
    imported = read(SHAPES[name])
    xml = file_of(SHAPES[name])
    ports = sum(len(node.args.values) for node in walk(imported.tree) if node.action)  # type: ignore[union-attr]
    hidden = re.findall(r'(?:number_of_retries|num_attempts|hz)="', xml)
    assert ports == len(re.findall(r'\w="', xml.split("<TreeNodesModel>")[0])) - 3 - len(hidden)
    rows = (ROOT / "docs" / "exports.md").read_text(encoding="utf-8")
    assert f"| `{name}` | {table_of(imported) or 'none'} |" in rows
    vocabulary = declared(xml, xml, name="model.xml")
    assert parse(imported.text, vocabulary) == imported.tree


@pytest.mark.parametrize("name", [n for n, s in SHAPES.items() if "Controller " not in s])
def test_published_trees_come_back(name: str) -> None:
    """Such a tree, but for its decorators that are leaves here, comes back from XML."""
    imported = read(SHAPES[name])
    xml = file_of(SHAPES[name])
    vocabulary = declared(xml, xml, name="model.xml")
    assert read_tree(to_xml(imported.tree, vocabulary), vocabulary).tree == imported.tree


def ticks(tree: Node, count: int, **scripts: str) -> list[tuple[list[str], int]]:
    """The leaves that each tick calls, and its status; a script's last letter goes on."""
    letters = {"F": FAILURE, "S": SUCCESS, "R": RUNNING}
    coming = {name: list(script) for name, script in scripts.items()}
    called: list[str] = []

    def leaf_of(args: ActionArgs) -> object:
        def act(fresh: bool) -> int:  # noqa: ARG001
            called.append(args.name)
            remaining = coming.get(args.name, ["S"])
            return letters[remaining.pop(0) if len(remaining) > 1 else remaining[0]]

        return act

    tick = compile_tree(tree, leaf_of, [], {}, step_s=0.5)  # type: ignore[arg-type]
    rows = []
    for _ in range(count):
        status = tick()
        rows.append(([*called], status))
        called.clear()
    return rows


def test_a_published_tree_runs() -> None:
    """Planning goes on once a second while the robot drives; a failure brings a recovery."""
    tree = read(SHAPES["navigate_to_pose_w_replanning_and_recovery"]).tree
    rows = ticks(tree, 5, FollowPath="R")
    planned = ["ComputePathToPose" in calls for calls, _ in rows]
    assert planned == [True, False, True, False, True]
    assert all(status >= RUNNING for _, status in rows)
    ((calls, _),) = ticks(tree, 1, FollowPath="FR")
    assert calls[-4:] == [
        "FollowPath", "WouldAControllerRecoveryHelp", "ClearEntireCostmap", "FollowPath"
    ]  # fmt: skip


BRANCHES = {
    "<IfThenElse><Free/><Go/></IfThenElse>": ("if_else { Free Go }", ""),
    '<IfThenElse><ScriptCondition code="low"/><Go/></IfThenElse>': (
        "if_else { when low abort none { always success } Go }", ""),
    "<IfThenElse><Free/><Go/><Stay/></IfThenElse>": (
        "if_else { Free Go Stay }", ""),
    "<IfThenElse><Go/><Stay/><Clear/></IfThenElse>": ("if_else { Go Stay Clear }", ""),
    '<WhileDoElse><ScriptCondition code="low"/><Go/><Stay/></WhileDoElse>': (
        "selector { when low { Go } when not low abort self { Stay } }", ""),
    "<WhileDoElse><Free/><Go/><Stay/></WhileDoElse>": (
        "reactive_sequence { reactive_selector { inverter { Free } Go }"
        " reactive_selector { Free Stay } }", "order, twice"),
    '<Switch2 variable="{mode}" case_1="1" case_2="2"><Go/><Stay/><Clear/></Switch2>': (
        "selector { when mode == 1 { Go } when mode == 2 { Stay }"
        " when mode != 1 and mode != 2 abort self { Clear } }", "equal"),
    '<Fallback><Inverter><WhileDoElse><ScriptCondition code="low"/><Go/><Switch2 variable="{mode}"'
    ' case_1="1" case_2="2"><Go/><Stay/><Clear/></Switch2></WhileDoElse></Inverter><Stay/>'
    "</Fallback>": (
        "selector { inverter { selector { when low { Go } when not low abort self { selector {"
        " when mode == 1 { Go } when mode == 2 { Stay }"
        " when mode != 1 and mode != 2 abort self { Clear } } } } } Stay }", "equal"),
    '<Sequence><Go _failureIf="low"/><Stay/></Sequence>': (
        "sequence { when not low abort none { Go } Stay }", ""),
    '<Sequence><Go _successIf="low"/><Stay/></Sequence>': (
        "sequence { selector { when low abort none { always success } Go } Stay }", ""),
    '<Precondition if="low"><Go/></Precondition>': ("when low abort none { Go }", ""),
    '<Precondition if="low" else="SUCCESS"><Go/></Precondition>': (
        "selector { when not low abort none { always success } Go }", ""),
    '<Precondition if="low" else="RUNNING"><Go/></Precondition>': (
        "sequence { until_success { when low abort none { always success } } Go }", ""),
    '<Fallback><Go _skipIf="low"/><Stay/></Fallback>': (
        "selector { when not low abort none { Go } Stay }", "skipped"),
    '<Sequence><Go _while="low"/><Stay/></Sequence>': (
        "sequence { reactive_selector { when not low abort none { always success } Go } Stay }",
        "skipped"),
    '<Sequence><Go _skipIf="false"/><Stay _skipIf="true"/></Sequence>': (
        "sequence { Go always success }", "skipped"),
    "<KeepRunningUntilFailure><Go/></KeepRunningUntilFailure>": ("until_failure { Go }", ""),
    '<RoundRobin wrap_around="true"><Go/><Stay/></RoundRobin>': ("round_robin { Go Stay }", ""),
    '<Go goal="map frame/dock 1"/>': ('Go(goal: "map frame/dock 1")', ""),
    '<Go goal="selector"/>': ('Go(goal: "selector")', ""),
}  # fmt: skip


@pytest.mark.parametrize("xml", BRANCHES)
def test_branching_nodes(xml: str) -> None:
    """Branching nodes and preconditions become guards, with what is not quite the same."""
    tree, differences = BRANCHES[xml]
    imported = inside(xml)
    assert (imported.tree, table_of(imported)) == (parse(tree, ROBOT), differences)
    assert parse(to_text(imported.tree)) == imported.tree  # without a vocabulary as well


def in_the_library(xml: str, boards: Sequence[Sequence[float]], results: Sequence[int]) -> Trace:
    """What the real library does with a file."""
    cpp: Any = pytest.importorskip("behaviortreepy", reason="extra `btcpp` is not installed")
    script = Script(results)
    statuses = (cpp.NodeStatus.FAILURE, cpp.NodeStatus.SUCCESS, cpp.NodeStatus.RUNNING)
    factory = cpp.BehaviorTreeFactory()
    for name in ("Go", "Stay", "Clear"):
        factory.register_simple_stateful_action(
            name,
            lambda _, name=name: statuses[script.call(name, True)],
            lambda _, name=name: statuses[script.call(name, False)],
            lambda _, name=name: script.halt(name),
        )
    tree = factory.create_tree_from_text(xml)
    board = tree.root_blackboard()
    trace = []
    for low, mode in boards:
        board.set_bool("low", bool(low))
        board.set_string("mode", f"{mode:.0f}")  # of a Switch, texts are compared
        trace.append(script.take(tree.tick_exactly_once().name))
    return trace


@pytest.mark.parametrize(
    "xml",
    [x for x in BRANCHES if "goal" not in x and "Free" not in x and "RoundRobin" not in x],
)
def test_branching_in_the_library(xml: str) -> None:
    """The tree that is read starts, resumes and halts the leaves as the real library does."""
    rng = Random(1)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="M">{xml}</BehaviorTree></root>'
    tree = inside(xml).tree
    for _ in range(30):
        results = [rng.choice([FAILURE, SUCCESS, RUNNING, RUNNING]) for _ in range(60)]
        boards = [[float(rng.randint(0, 1)), float(rng.randint(0, 3))] for _ in range(20)]
        trace = ours(tree, boards, results, ROBOT.key_index)
        assert trace == in_the_library(text, boards, results)


REFUSED = {
    "<IfThenElse><Go/></IfThenElse>": "expected two or three children in <IfThenElse>, found 1",
    "<WhileDoElse><Go/><Stay/></WhileDoElse>": "a condition as the first child of WhileDoElse",
    "<WhileDoElse><Free/></WhileDoElse>": "two or three children",
    '<Switch2 variable="{mode}" case_1="1"><Go/><Stay/></Switch2>': "does not fit mode",
    '<Go _skipIf="low"/>': "'_skipIf' is imported only in a Sequence or a Fallback",
    '<Go _onSuccess="x := 1"/>': "unknown key with an `initial` value 'x'",
    '<RecoveryNode number_of_retries="2"><Go/></RecoveryNode>': "two children in <RecoveryNode>",
    '<RateController hz="0"><Go/></RateController>': "expected hz from",
    "<NonblockingSequence><Go/></NonblockingSequence>": "no node 'NonblockingSequence'",
    "<Go goal='a \"b\"'/>": 'expected goal of "a text"',
}


@pytest.mark.parametrize("xml", REFUSED)
def test_refused_nodes(xml: str) -> None:
    """What has no equal here is refused with its place and the reason."""
    with pytest.raises(TreeError, match=r"^<xml>:1:\d+: ") as excinfo:
        inside(xml)
    assert REFUSED[xml] in str(excinfo.value)


def test_ports_of_remapped_subtrees() -> None:
    """A port that names an entry of a SubTree's blackboard names the entry that it is mapped to."""
    xml = (
        '<root main_tree_to_execute="A"><BehaviorTree ID="A"><SubTree ID="B" goal="{dock}"/>'
        '</BehaviorTree><BehaviorTree ID="B"><Go goal="{goal}"/></BehaviorTree></root>'
    )
    assert read_tree(xml, ROBOT).tree == parse('Go(goal: "{dock}")', ROBOT)


@pytest.mark.parametrize("head", ["every 2", "pipeline", "round_robin", "recovery 2"])
def test_nodes_of_nav2(head: str) -> None:
    """XML has them as Nav2's; py_trees has none of them."""
    tree = parse(f"{head} {{ Go {'Stay' if head == 'recovery 2' else ''} }}", ROBOT)
    with pytest.raises(DomainError, match="run it in Python"):
        py_trees.to_python(tree, ROBOT)
    assert "Nav2's" in needs(to_xml(tree, ROBOT))[0]
    assert read_tree(to_xml(tree, ROBOT), ROBOT).tree == tree
