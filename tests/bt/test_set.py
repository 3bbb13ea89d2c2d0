"""Data flow: keys that trees and actions write, and keys that give arguments their values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from islandgp import load_tree
from islandgp.bt.analysis.lint import warnings
from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import AGAIN, RUNNING, SUCCESS
from islandgp.bt.core.parameters import one_of, real, text
from islandgp.bt.core.vocabulary import Action, Key, Vocabulary, enumeration, flag, integer, number
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.bt.export.py_trees import to_python
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError, TreeError
from islandgp_numbers.numbers import numbers_of
from tests.trees.exactness import PLACES, writing
from tests.trees.targets import ours

WORDS = ("dock", "shelf")
BOT = Vocabulary(
    "bot",
    {
        "Go": Action("drives", arguments={"to": one_of("", WORDS), "speed": real("", 0, 9)}),
        "Look": Action("measures the gap", sets=("gap",)),
        "Say": Action("speaks", arguments={"words": text("what")}),
    },
    {
        "near": flag("at the goal"),
        "tries": integer("attempts", 0, 5, most=9, initial=0),
        "gap": number("m", -5, 5, initial=1.5),
        "place": enumeration("where to", WORDS, initial="dock"),
        "done": flag("done", initial="no"),
    },
)


@pytest.mark.parametrize(
    "assignment",
    [
        "tries = 3",
        "tries = tries + 1",
        "gap = 0.5 * gap - tries / 2",
        "gap = -gap",
        "place = shelf",
        "done = yes",
        "done = near",
    ],
)
def test_an_assignment_is_read_and_written_everywhere(assignment: str) -> None:
    """Text, format, JSON, both exports, and the import of one of them."""
    tree = parse(f"set {assignment}", BOT)
    assert to_text(tree) == f"set {assignment}\n" == format_text(f"set  {assignment} ")
    assert parse(to_text(tree)) == parse(f"set {assignment}")
    assert read_tree(to_xml(tree, BOT), BOT).tree == tree
    assert f"SetKey('set {assignment}'" in to_python(tree, BOT)
    assert numbers_of(f"sequence {{ set {assignment} }}", BOT) == []


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("tries = 12", "tries can't be 12"),
        ("tries = 0.5", "a whole number of at least 0 and at most 9"),
        ("tries = tries / 2", "tries can't be tries / 2"),
        ("near = yes", "unknown key with an `initial` value 'near'"),
        ("gab = 1", "Did you mean gap?"),
        ("place = shelv", "'shelv' does not fit place"),
        ("done = 3", "no | yes | near"),
        ("gap = near", "'near' does not fit gap"),
        ("gap = 1 / 0", "division by 0"),
        ("gap", "Expected ="),
        ("", "a name"),
    ],
)
def test_wrong_assignments(assignment: str, message: str) -> None:
    """Each is reported at its place, with what is valid there."""
    with pytest.raises(TreeError) as error:
        parse(f"set {assignment}", BOT)
    assert message in str(error.value)


def test_keys_and_values_can_be_parameters() -> None:
    """A subtree can write the key that is passed to it."""
    put = "subtree put(k, v) = set k = v"
    tree = parse(f"{put} sequence {{ use put(tries, 2) use put(place, dock) }}", BOT)
    assert to_text(tree) == "sequence { set tries = 2 set place = dock }\n"


def ticked(
    source: str, times: int, leaf: int = RUNNING
) -> tuple[list[int], list[float], list[str]]:
    """The statuses of ticks, the blackboard after them, and the calls."""
    board, calls = [key.start for key in BOT.keys.values()], list[str]()

    def tick_of(args: Any) -> Any:
        return lambda fresh: calls.append(args.name + "!" * fresh) or leaf

    tick = compile_tree(parse(source, BOT), tick_of, board, BOT.key_index)
    return [tick() for _ in range(times)], board, calls


def test_nodes_that_tick_later_see_the_new_value() -> None:
    """A guard behind a `set` in the same tick, and in the next ticks."""
    source = "selector { sequence { set tries = tries + 1 when tries > 2 { Go } } Look }"
    statuses, board, calls = ticked(source, 3, SUCCESS)
    assert (statuses, board[1]) == ([SUCCESS] * 3, 3.0)
    assert calls == ["Look!", "Look!", "Go!"]


def test_a_written_key_asks_for_the_next_tick() -> None:
    """A guard that was evaluated before it in the tick may be false now."""
    source = "parallel { when tries < 1 { Go } sequence { set tries = 1 Look } }"
    statuses, _, calls = ticked(source, 2)
    assert statuses == [AGAIN, 0]
    assert calls == ["Go!", "Look!", "Look"]


def test_no_fact_outlives_a_set() -> None:
    """`check` and `simplify` conclude nothing from a guard whose key a node below writes."""
    source = "when tries < 3 abort none { sequence { set tries = 5 when tries > 4 { Go } } }"
    assert warnings(source, BOT) == []
    assert simplify(parse(source, BOT), BOT).reasons == ()
    result = "when gap < 1 abort none { sequence { Look when gap > 2 { Go } } }"
    assert warnings(result, BOT) == []
    impossible = "when tries < 3 { sequence { set gap = 5 when tries > 4 { Go } } }"
    assert "can never run" in warnings(impossible, BOT)[0].message


def test_a_simplified_tree_does_the_same() -> None:
    """Random trees with many assignments, on random blackboards."""
    shorter = 0
    for case in writing(150):
        tree = simplify(case.tree, VOCABULARY).tree
        shorter += tree != case.tree
        assert ours(tree, case.boards, case.results, PLACES) == ours(
            case.tree, case.boards, case.results, PLACES
        )
    assert shorter > 30


def test_a_program_gets_and_sets_keys(tmp_path: Path) -> None:
    """Arguments are values of keys; a mapping is the result of an action that succeeds."""
    file, seen = tmp_path / "my tree.bt", []
    file.write_text(
        'sequence { Look set place = shelf Go(to: "{place}", speed: "{gap}") Say(words: "{x}") }'
    )

    def go(to: str, speed: float) -> bool:
        seen.append((to, speed))
        return True

    leaves = {"Look": lambda: {"gap": 2.5}, "Go": go, "Say": lambda words: seen.append(words) or 1}
    with load_tree(file, BOT).bind(leaves, {}) as tree:
        assert tree.tick() == SUCCESS
    assert seen == [("shelf", 2.5), "{x}"]
    for wrong in ({"near": 1}, {"gap": "wide"}):
        tree = load_tree(file, BOT).bind({**leaves, "Look": lambda w=wrong: w}, {})
        with pytest.raises(DomainError, match="of Look"):
            tree.tick()


@pytest.mark.parametrize(
    ("value", "message"),
    [('"{near}"', "is not a value of to"), ('"{gap}"', "dock | shelf"), ("3", "dock")],
)
def test_a_key_of_another_type_is_no_argument(value: str, message: str) -> None:
    """The message names the keys that fit."""
    with pytest.raises(TreeError) as error:
        parse(f"Go(to: {value})", BOT)
    assert message in str(error.value)


@pytest.mark.parametrize(
    "wrong",
    [
        integer("", 0, 5, initial=7, most=6),
        integer("", 0, 5, initial=0.5),  # type: ignore[arg-type] # the mistake
        enumeration("", WORDS, initial="bin"),
        flag("", initial="maybe"),
        Key("", initial=2),
    ],
)
def test_wrong_initial_values(wrong: Key) -> None:
    """A key begins with a value that it can have."""
    with pytest.raises(DomainError, match="as initial for the key k"):
        Vocabulary("d", {}, {"k": wrong})


def test_arguments_of_keys_in_other_tools() -> None:
    """Ports of BehaviorTree.CPP have them; for py_trees the message says what to do."""
    tree = parse('Go(to: "{place}", speed: "{gap}")', BOT)
    assert '<Go to="{place}" speed="{gap}"/>' in to_xml(tree, BOT)
    assert read_tree(to_xml(tree, BOT), BOT).tree == tree
    with pytest.raises(DomainError, match="export it as XML"):
        to_python(tree, BOT)


def test_only_written_keys_are_results() -> None:
    """An action cannot set a key of the domain."""
    with pytest.raises(DomainError, match="keys with an initial value as `sets` for the action A"):
        Vocabulary("d", {"A": Action("", sets=("near",))}, {"near": flag("")})


BLACKBOARD = """<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence>
      <SetBlackboard value="dock" output_key="place"/>
      <Script code="tries := 0; done = false"/>
      <RetryUntilSuccessful num_attempts="3">
        <Sequence><Script code="tries += 1"/><MoveTo goal="{place}"/></Sequence>
      </RetryUntilSuccessful>
      <ScriptCondition code="tries &lt; 3 &amp;&amp; place == 'dock' &amp;&amp; !done"/>
    </Sequence>
  </BehaviorTree>
  <TreeNodesModel><Action ID="MoveTo"><input_port name="goal" type="std::string"/></Action>
  </TreeNodesModel>
</root>"""


def test_scripts_of_a_file_are_read_and_run(tmp_path: Path) -> None:
    """The keys and their types follow from the scripts."""
    vocabulary = declared(BLACKBOARD, BLACKBOARD, name="m.xml")
    assert vocabulary.keys["place"] == enumeration("", ["dock"], initial="dock")
    tree, goals = read_tree(BLACKBOARD, vocabulary), list[str]()
    file = tmp_path / "t.bt"
    file.write_text(tree.text)
    assert "sequence { set tries = tries + 1 MoveTo" in tree.text
    leaves = {"MoveTo": lambda goal: goals.append(goal) or len(goals) > 1}
    with load_tree(file, vocabulary).bind(leaves, {}) as robot:
        assert [robot.tick(), robot.tick()] == [RUNNING, SUCCESS]
    assert goals == ["dock", "dock"]
    again = to_xml(tree.tree, vocabulary)
    assert read_tree(again, vocabulary).tree == tree.tree


def test_a_parameter_in_an_assignment() -> None:
    """It has any value in the definition; a wrong one is refused where it is used."""
    bump = "subtree bump(by) = set tries = by + tries use bump({})"
    assert parse(bump.format(1), BOT) == parse("set tries = 1 + tries", BOT)
    with pytest.raises(TreeError, match=r"tries can't be 0\.5 \+ tries"):
        parse(bump.format(0.5), BOT)
