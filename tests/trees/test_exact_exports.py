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
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, CountArgs, Node, leaf, walk
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
@given(tree=TREES, boards=BOARDS, results=RESULTS)
@example(
    tree=parse("parallel success 1 { PatrolWaypoint ExecuteCharge }"),
    boards=[[0.0] * len(PLACES)],
    results=[SUCCESS, RUNNING],
)
@example(  # py_trees does not tick a child to its end if that succeeds below a selector
    tree=parse("until_failure { selector { cooldown 2 { ExecuteCharge } } }"),
    boards=[[0.0] * len(PLACES)] * 3,
    results=[SUCCESS],
)
def test_py_trees(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """The exported module starts, resumes and halts the same leaves in the same order."""
    tree = named(tree)
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
        for plain in (False, True):
            unnamed_trace = in_py_trees(unnamed(parted), boards, results, PLACES, plain=plain)
            assert in_py_trees(parted, boards, results, PLACES, plain=plain) == unnamed_trace
        assert in_py_trees(parted, boards, results, PLACES) == ours(parted, boards, results, PLACES)


def test_subtrees_in_behaviortree_cpp(cpp: BehaviorTreeCpp) -> None:
    """And SubTrees there."""
    for tree, boards, results, *_ in random_cases(cases(300)):
        parted = in_subtrees(tree, Random(len(boards) + len(leaves(tree))))
        expected = ours(parted, boards, results, PLACES)
        for tick_function in ("exactly", "once"):
            assert cpp.trace(parted, boards, results, tick_function=tick_function) == expected
        unnamed_trace = cpp.trace(unnamed(parted), boards, results, plain=True)
        assert cpp.trace(parted, boards, results, plain=True) == unnamed_trace


def unnamed(tree: Node) -> Node:
    """The tree without the names of subtrees."""
    return Node(tree.kind, tree.args, tuple(map(unnamed, tree.children)))


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
    assert row.calls > row.ticks > row.trees
    assert row.differences == (None, 0, 0)  # the export to py_trees rejects them


def test_an_ended_action_in_a_pipeline(cpp: BehaviorTreeCpp) -> None:
    """The stated loss: a StatefulActionNode of the library does not start again there."""
    tree = named(parse("pipeline { PatrolWaypoint PatrolWaypoint }"))
    boards, results = [[0.0] * len(PLACES)] * 2, [SUCCESS, RUNNING]
    assert ours(tree, boards, results, PLACES)[1] == "Leaf0! Leaf1 = RUNNING"
    assert cpp.trace(tree, boards, results, plain=True)[1] == "Leaf1 = SUCCESS"


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


@MANY
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_plain_py_trees(tree: Node, boards: list[list[float]], results: list[int]) -> None:
    """A plain module of a tree without stated losses does the same, halts included."""
    tree = named(tree)
    assume(not py_trees.losses(tree))
    expected = ours(tree, boards, results, PLACES)
    assert in_py_trees(tree, boards, results, PLACES, plain=True) == expected


@MANY
@given(tree=TREES, boards=BOARDS, results=RESULTS)
def test_plain_behaviortree_cpp(
    cpp: BehaviorTreeCpp, tree: Node, boards: list[list[float]], results: list[int]
) -> None:
    """So does a plain file."""
    tree = named(tree)
    assume(not behaviortree_cpp.losses(tree))
    expected = ours(tree, boards, results, PLACES)
    assert cpp.trace(tree, boards, results, plain=True) == expected


# Examples by loss: the tree, the true flags in each tick (p: foundGarbage, q:
# isHumanoidWantToClear), the results of the leaves one after the other, and the expected calls of
# leaves: of our engine, and of the libraries with a plain file.
EXAMPLES_OF_LOSSES = {
    "level": (
        "selector { when p { A } B }", ["p", "p", "p"], "FRRRRR",
        ["A! B!", "B", "B"], ["A! B!", "A! -B", "A"],
    ),
    "order": (
        "selector { when p { A } B }", ["", "p"], "RR",
        ["B!", "-B A!"], ["B!", "A! -B"],
    ),
    "resumed": (
        "selector { when p { A } B }", ["", "p"], "RFR",
        ["B!", "-B A! B!"], ["B!", "A! B"],
    ),
    "inner": (
        "selector { when p { when q abort none { A } } B }", ["p", "p", "pq"], "RRRRRR",
        ["B!", "B", "B"], ["B!", "B", "A! -B"],
    ),
    "dropped": (
        "sequence { when p { A } B }", ["p", "", "p"], "SRRRRR",
        ["A! B!", "B", "-B A!"], ["A! B!", "B", "B"],
    ),
}  # fmt: skip
EXAMPLES_IN_CPP = {
    "repeat": ("repeater 2 { A }", [""] * 3, "RSRRR", ["A!", "A", "A!"], ["A!", "A A!", "A"]),
    "judged": ("parallel { A B }", [""] * 2, "FRFR", ["A! B! -B", "A! B! -B"], ["A!", "A! B! -A"]),
    "policy": ("parallel failure all { A B }", [""] * 2, "FRRRRR", ["A! B!", "B"], ["A!", "A! B!"]),
    # A guard under a repeater hands over after its repetitions only: dropped, not reactive.
    "dropped": (
        "sequence { repeater 2 { inverter { when p { A } } } B }", ["", "", "p"], "RRR",
        ["", "B!", "-B A!"], ["", "B!", "B"],
    ),
}  # fmt: skip


def boards_of(flags: list[str]) -> list[list[float]]:
    keys = {"foundGarbage": "p", "isHumanoidWantToClear": "q"}
    return [[float(keys.get(name, "-") in now) for name in PLACES] for now in flags]


def short_trace(trace: list[str], tree: Node) -> list[str]:
    """The trace in the short names of `stage`, without the root's status."""
    letters = dict(zip(VOCABULARY.actions, "ABCDEFG", strict=True))
    lines = []
    for line in trace:
        calls = line.partition("=")[0]
        for name in leaves(tree):
            calls = calls.replace(name, letters[name])
        lines.append(calls.strip())
    return lines


@pytest.mark.parametrize("about", EXAMPLES_OF_LOSSES)
def test_losses_of_plain_files(cpp: BehaviorTreeCpp, about: str) -> None:
    """Each loss is stated for its tree, both libraries show it, and our nodes take it away."""
    text, flags, letters, ours_expected, theirs_expected = EXAMPLES_OF_LOSSES[about]
    tree, boards = short_tree(text), boards_of(flags)
    results = ["FSR".index(letter) for letter in letters]
    assert about in {loss.about for loss in behaviortree_cpp.losses(tree)}
    assert about in {loss.about for loss in py_trees.losses(tree)}
    assert short_trace(ours(tree, boards, results, PLACES), tree) == ours_expected
    assert short_trace(cpp.trace(tree, boards, results, plain=True), tree) == theirs_expected
    assert (
        short_trace(in_py_trees(tree, boards, results, PLACES, plain=True), tree) == theirs_expected
    )
    assert short_trace(cpp.trace(tree, boards, results), tree) == ours_expected
    assert short_trace(in_py_trees(tree, boards, results, PLACES), tree) == ours_expected


@pytest.mark.parametrize("about", EXAMPLES_IN_CPP)
def test_losses_of_plain_files_in_behaviortree_cpp(cpp: BehaviorTreeCpp, about: str) -> None:
    """So for the losses that only BehaviorTree.CPP has."""
    text, flags, letters, ours_expected, theirs_expected = EXAMPLES_IN_CPP[about]
    tree, boards = short_tree(text), boards_of(flags)
    results = ["FSR".index(letter) for letter in letters]
    assert about in {loss.about for loss in behaviortree_cpp.losses(tree)}
    assert short_trace(ours(tree, boards, results, PLACES), tree) == ours_expected
    assert short_trace(cpp.trace(tree, boards, results, plain=True), tree) == theirs_expected
    assert short_trace(cpp.trace(tree, boards, results), tree) == ours_expected


def test_equal_within_a_little(cpp: BehaviorTreeCpp) -> None:
    """`==` of a plain file takes 3.0000001 for 3; our node does not."""
    tree = short_tree("when x == 3 { A }")
    boards = [[3.0000001 if name == "batteryLevel" else 0.0 for name in PLACES]]
    assert [loss.about for loss in behaviortree_cpp.losses(tree)] == ["equal"]
    assert short_trace(cpp.trace(tree, boards, [RUNNING], plain=True), tree) == ["A!"]
    assert short_trace(cpp.trace(tree, boards, [RUNNING]), tree) == [""]


# Which function is one tick: a Repeat of the library under tickExactlyOnce and tickOnce.
REPEATS = {
    # The leaf ends in its first tick. Repeat gives way to others, with a wake-up signal: until the
    # next call of tickExactlyOnce; not at all under tickOnce, which obeys the signal.
    "S": (["A! = RUNNING", "A! = RUNNING", "A! = SUCCESS"], ["A! A! A! = SUCCESS"] * 2),
    # It ends in a later tick: the next repetition begins at once, under both.
    "RS": (["A! = RUNNING", *["A A! = RUNNING"] * 2], ["A! = RUNNING", *["A A! = RUNNING"] * 2]),
}  # fmt: skip


@pytest.mark.parametrize("letters", REPEATS)
def test_repeat_and_the_tick_function(cpp: BehaviorTreeCpp, letters: str) -> None:
    """The statement of docs/exports.md on Repeat holds for both tick functions."""
    tree = Node("repeater", CountArgs(3), (leaf("A"),))
    results = ["FSR".index(letter) for letter in letters]
    exactly, once = REPEATS[letters]
    xml = behaviortree_cpp.to_xml(tree, plain=True)
    boards = boards_of([""] * 3)
    assert (
        cpp.trace_of(xml, ["A"], boards[: len(exactly)], results, tick_function="exactly")
        == exactly
    )
    assert cpp.trace_of(xml, ["A"], boards[: len(once)], results, tick_function="once") == once


def test_names_of_the_library() -> None:
    """An action with the name of a node over there is refused; one called Robot is not."""
    with pytest.raises(DomainError, match="found 'Fallback'; rename"):
        behaviortree_cpp.to_xml(leaf("Fallback"))
    assert 'ID="RobotTree"' in behaviortree_cpp.to_xml(leaf("Robot"))


def test_files_without_our_nodes() -> None:
    """A tree that needs none of our nodes is the plain file."""
    tree = short_tree("selector { when p abort self { A } inverter { B } repeater 1 { C } }")
    assert not behaviortree_cpp.needs_header(tree)
    assert behaviortree_cpp.to_xml(tree) == behaviortree_cpp.to_xml(tree, plain=True)
    assert py_trees.to_python(tree) == py_trees.to_python(tree, plain=True)


def test_meanings_in_a_docstring() -> None:
    """No meaning of a key ends the docstring of the exported module."""
    vocabulary = Vocabulary("odd", {"A": Action("")}, {"p": flag('a """ quote, a \\N backslash')})
    tree = parse("when p { A }", vocabulary)
    code = compile(py_trees.to_python(tree, vocabulary), "exported", "exec")
    assert "p: a ''' quote, a \\N backslash" in str(code.co_consts[0])
