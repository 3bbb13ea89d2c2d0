"""Every exported tree does in other libraries what it does here, call by call."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, Phase, assume, example, given
from hypothesis import strategies as st

from islandgp.bt.core.format import format_text
from islandgp.bt.core.kinds import NAV2
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node, leaf, walk
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.import_cpp import read_tree
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError
from tests.bt.stage import short_tree
from tests.profiles import cases, examples, sweep
from tests.strategies import few_boards, few_numbers, nodes
from tests.trees.exactness import (
    EXAMPLES,
    PAGE,
    PLACES,
    comparing_keys,
    exactness,
    in_subtrees,
    named,
    nav2_cases,
    random_cases,
    recorded,
    tried,
    with_table,
)
from tests.trees.targets import BehaviorTreeCpp, compiled, in_py_trees, leaves, ours
from tests.viewer.episodes import island

BOARDS = st.lists(few_boards(), min_size=2, max_size=14)
RESULTS = st.lists(st.sampled_from([FAILURE, SUCCESS, RUNNING, RUNNING]), min_size=1, max_size=40)
TREES = nodes(few_numbers(), max_leaves=10, max_repeats=3, nav2=False)
IN_PY_TREES = nodes(few_numbers(), max_leaves=10, max_repeats=3, nav2=False, if_else=False)
MANY = examples(
    max_examples=300, suppress_health_check=[*HealthCheck], phases=[Phase.explicit, Phase.generate]
)


@pytest.fixture(scope="module")
def cpp(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BehaviorTreeCpp]:
    """The real BehaviorTree.CPP with our nodes."""
    process = BehaviorTreeCpp(compiled(tmp_path_factory.mktemp("btcpp")), VOCABULARY)
    yield process
    process.close()


@MANY
@given(tree=IN_PY_TREES, boards=BOARDS, results=RESULTS)
@example(
    tree=parse("parallel success 1 { PatrolWaypoint ExecuteCharge }"),
    boards=[[0.0] * len(PLACES)],
    results=[SUCCESS, RUNNING],
)
def test_py_trees(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """The exported module starts, resumes and halts the same leaves in the same order."""
    tree = named(tree)
    assume(not any(node.kind == "cooldown" for node in walk(tree)))  # there is no such node
    assert in_py_trees(tree, boards, results, PLACES) == ours(tree, boards, results, PLACES)


@MANY
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_behaviortree_cpp(
    cpp: BehaviorTreeCpp, tree: Node, boards: list[list[float]], results: list[int]
) -> None:
    """The exported file does so with our header, whichever function ticks the tree once."""
    tree = named(tree)
    assume(not any(node.kind == "cooldown" for node in walk(tree)))  # there is no such node
    expected = ours(tree, boards, results, PLACES)
    assert cpp.trace(tree, boards, results) == expected
    assert cpp.trace(tree, boards, results, tick_function="once") == expected


@pytest.mark.slow
def test_many_interruptions_in_py_trees() -> None:
    """So it is for trees with many guards that interrupt."""
    for tree, boards, results, *_ in random_cases(cases(1000)):
        assert in_py_trees(tree, boards, results, PLACES) == ours(tree, boards, results, PLACES)


def test_many_interruptions_in_behaviortree_cpp(cpp: BehaviorTreeCpp) -> None:
    """And there."""
    for tree, boards, results, *_ in random_cases(cases(1000)):
        assert cpp.trace(tree, boards, results) == ours(tree, boards, results, PLACES)


@pytest.mark.slow
def test_subtrees_in_py_trees() -> None:
    """Subtrees are functions of their names there, and change nothing of what the tree does."""
    for tree, boards, results, *_ in random_cases(cases(150)):
        parted = in_subtrees(tree, Random(len(boards) + len(leaves(tree))))
        assert in_py_trees(parted, boards, results, PLACES) == ours(parted, boards, results, PLACES)


def test_subtrees_in_behaviortree_cpp(cpp: BehaviorTreeCpp) -> None:
    """And SubTrees there."""
    for tree, boards, results, *_ in random_cases(cases(300)):
        parted = in_subtrees(tree, Random(len(boards) + len(leaves(tree))))
        expected = ours(parted, boards, results, PLACES)
        for tick_function in ("exactly", "once"):
            assert cpp.trace(parted, boards, results, tick_function=tick_function) == expected


PARTED = """subtree charge(below) = when batteryLevel < below {
  sequence { SeekCharger ExecuteCharge }
}
subtree twice = sequence { use charge(20) use charge(30) }
subtree alias = use twice
selector { use alias inverter { use charge(20) } use twice }
"""


def test_subtrees_and_back() -> None:
    """A file has a tree for each subtree and its numbers; reading it gives them back."""
    tree = parse(PARTED, VOCABULARY, marked=True)
    xml = behaviortree_cpp.to_xml(tree, VOCABULARY)
    ids = re.findall(r'<BehaviorTree ID="(\w+)"', xml)
    assert ids == ["Robot", "charge_20", "charge_30", "twice", "alias"]
    assert xml.count('_autoremap="true"') == 6
    assert (
        format_text(read_tree(xml, VOCABULARY).text)
        == """subtree charge_20 = when batteryLevel < 20 {
  sequence { SeekCharger ExecuteCharge }
}

subtree charge_30 = when batteryLevel < 30 {
  sequence { SeekCharger ExecuteCharge }
}

subtree twice = sequence { use charge_20 use charge_30 }

subtree alias = use twice

selector {
  use alias
  inverter { use charge_20 }
  use twice
}
"""
    )
    imported = parse(read_tree(xml, VOCABULARY).text, VOCABULARY, marked=True)
    assert behaviortree_cpp.to_xml(imported, VOCABULARY) == xml


def test_private_keys() -> None:
    """Over there a SubTree does not see `_x` of the tree above, so its body replaces it."""
    vocabulary = Vocabulary("odd", {"A": Action("")}, {"_x": flag("")})
    tree = parse("subtree s = when _x { A } use s", vocabulary, marked=True)
    assert "SubTree" not in behaviortree_cpp.to_xml(tree, vocabulary)


@sweep("path", EXAMPLES, ids=lambda path: path.stem, quick=3)
@examples(max_examples=30, suppress_health_check=[*HealthCheck])
@given(boards=st.lists(few_boards(), min_size=20, max_size=40), results=RESULTS)
def test_examples_in_py_trees(path: Path, boards: list[list[float]], results: list[int]) -> None:
    """So do the example trees in py_trees."""
    tree = named(parse(path.read_text(encoding="utf-8"), VOCABULARY))
    assert in_py_trees(tree, boards, results, PLACES) == ours(tree, boards, results, PLACES)


@sweep("path", EXAMPLES, ids=lambda path: path.stem, quick=3)
@examples(max_examples=30, suppress_health_check=[*HealthCheck])
@given(boards=st.lists(few_boards(), min_size=20, max_size=40), results=RESULTS)
def test_examples_in_behaviortree_cpp(
    cpp: BehaviorTreeCpp, path: Path, boards: list[list[float]], results: list[int]
) -> None:
    """And in BehaviorTree.CPP."""
    tree = named(parse(path.read_text(encoding="utf-8"), VOCABULARY))
    assert cpp.trace(tree, boards, results) == ours(tree, boards, results, PLACES)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_recorded_episodes(cpp: BehaviorTreeCpp, path: Path) -> None:
    """On what a whole episode was, an example does in both libraries what it did in the episode."""
    tree = parse(path.read_text(encoding="utf-8"), VOCABULARY)
    row = tried([recorded(tree, island())], cpp)
    assert row.ticks > 500  # a poor tree ends early
    assert row.calls >= row.ticks
    assert set(row.differences) == {0}


@pytest.mark.parametrize("kind", sorted(NAV2))
def test_models_of_nav2(cpp: BehaviorTreeCpp, kind: str) -> None:
    """Nav2's kinds do what models of Nav2's nodes do in BehaviorTree.CPP."""
    row = tried(nav2_cases(kind, cases(60)), cpp)
    assert min(row.calls, row.ticks) > row.trees
    assert row.differences == (None, 0, 0)  # the export to py_trees rejects them


def test_an_ended_action_in_a_pipeline(cpp: BehaviorTreeCpp) -> None:
    """As docs/exports.md says, a StatefulActionNode of the library does not start again there."""
    tree = named(parse("pipeline { PatrolWaypoint PatrolWaypoint }"))
    boards, results = [[0.0] * len(PLACES)] * 2, [SUCCESS, RUNNING]
    assert ours(tree, boards, results, PLACES)[1] == "Leaf0! Leaf1 = RUNNING"
    assert cpp.trace(tree, boards, results)[1] == "Leaf1 = SUCCESS"


def test_compared_keys(cpp: BehaviorTreeCpp) -> None:
    """Guards that compare two keys are the same in both libraries."""
    row = tried(comparing_keys(cases(60)), cpp)
    assert row.calls > row.trees
    assert set(row.differences) == {0}


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_the_figures_of_the_page(cpp: BehaviorTreeCpp) -> None:
    """1,000 random trees, over 100 evolved ones and the examples, in episodes, too: no difference.

    The figures are those of docs/exports.md; `python -m tests.trees.exactness` writes them.
    """
    rows = dict(exactness(cpp))
    assert {ticks for row in rows.values() for ticks in row.differences} == {0, None}
    assert min(row.trees for name, row in rows.items() if "evolved" in name) >= 100
    text = PAGE.read_text(encoding="utf-8")
    assert with_table(text, rows) == text


def test_library_nodes_where_they_are_equal() -> None:
    """A tree that needs none of our nodes has nodes of the library alone."""
    tree = short_tree("selector { when p abort self { A } inverter { B } repeater 1 { C } }")
    assert behaviortree_cpp.needs(behaviortree_cpp.to_xml(tree)) == []


def test_names_of_the_library() -> None:
    """An action with the name of a node over there is refused; one called Robot is not."""
    with pytest.raises(DomainError, match="found 'Fallback'; rename"):
        behaviortree_cpp.to_xml(leaf("Fallback"))
    assert 'ID="RobotTree"' in behaviortree_cpp.to_xml(leaf("Robot"))


def test_meanings_in_a_docstring() -> None:
    """No meaning of a key ends the docstring of the exported module."""
    vocabulary = Vocabulary("odd", {"A": Action("")}, {"p": flag('a """ quote, a \\N backslash')})
    tree = parse("when p { A }", vocabulary)
    code = compile(py_trees.to_python(tree, vocabulary), "exported", "exec")
    assert "p: a ''' quote, a \\N backslash" in str(code.co_consts[0])
