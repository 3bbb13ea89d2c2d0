"""Text to tree and back."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core import language
from islandgp.bt.core.builder import MAX_LEVELS, MAX_NODES
from islandgp.bt.core.condition import Condition
from islandgp.bt.core.language import MAX_CHARACTERS, parse, to_text
from islandgp.bt.core.node import CountArgs, GuardArgs, Node, ParallelArgs, depth, leaf, size
from islandgp.bt.core.printer import WIDTH, number_text
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import ConfigError, LimitError, TreeError
from tests.profiles import examples
from tests.strategies import nodes

PATROL = leaf("PatrolWaypoint")
PICKUP = leaf("PickupGarbage")


def parallel(success: str, failure: str) -> Node:
    return Node("parallel", ParallelArgs(success, failure), (PICKUP,))


# Printing


@examples(max_examples=300, deadline=None)
@given(nodes())
def test_parse_of_print_is_the_tree(node: Node) -> None:
    """Parsing the canonical text of any tree gives that tree again."""
    text = to_text(node)
    assert parse(text, VOCABULARY) == parse(text) == node


@examples(max_examples=300, deadline=None)
@given(nodes())
def test_print_of_parse_is_the_text(node: Node) -> None:
    """Canonical text stays as it is: formatting twice is formatting once."""
    text = to_text(node)
    assert to_text(parse(text)) == text


@given(nodes())
def test_printed_form(node: Node) -> None:
    """Printed text ends in one line end, has no trailing blanks, and lines of 80 columns.

    Only a line that can't be broken, the head of a very nested node, may be longer.
    """
    text = to_text(node)
    assert text.endswith("\n")
    assert not text.endswith("\n\n")
    for line in text.splitlines():
        assert line == line.rstrip()
        assert len(line) <= WIDTH or " } " not in line


CANONICAL = """\
selector {
  when batteryLevel < 25 abort lower { sequence { SeekCharger ExecuteCharge } }
  when robotCurrentExtraCapacity <= 5 { DeliverToClearingPoint }
  when isHumanoidWantToClear { MoveToHumanoid }
  when not foundGarbage abort none { PatrolWaypoint }
  parallel success one failure all { MoveToGarbage PickupGarbage }
  inverter { repeater 3 { PatrolWaypoint } }
  sequence {
    when lap != 2.5 abort self { PatrolWaypoint }
    parallel { PatrolWaypoint }
  }
}
"""


def test_canonical_text() -> None:
    """The canonical form, as a whole: nodes that read well on one line are on one."""
    assert to_text(parse(CANONICAL)) == CANONICAL


def test_defaults_are_not_printed() -> None:
    """What can be left out is left out; equal trees have equal text."""
    spelled = "parallel success all failure one { when lap < 1.0 abort both { PatrolWaypoint } }"
    short = "parallel { when lap < 1 { PatrolWaypoint } }"
    assert to_text(parse(spelled)) == to_text(parse(short))
    assert "abort" not in to_text(parse(spelled))


def test_layout_has_no_meaning() -> None:
    """Blanks, line ends of any system, comments and a byte order mark change nothing."""
    tree = parse("selector { PatrolWaypoint PickupGarbage }")
    assert parse("selector{PatrolWaypoint\tPickupGarbage}") == tree
    assert parse("# why\nselector {\n PatrolWaypoint # first\n PickupGarbage }\n#") == tree
    assert parse("\ufeffselector {\r\nPatrolWaypoint # a\r\nPickupGarbage\r\n}\r\n") == tree
    assert parse("# a\rselector { # b\rPatrolWaypoint PickupGarbage }\r") == tree


def test_long_nodes_are_broken() -> None:
    """A node that doesn't fit into 80 columns is broken, its children indented by two."""
    text = to_text(Node("sequence", (), (PATROL,) * 6))
    assert text == "sequence {\n" + "  PatrolWaypoint\n" * 6 + "}\n"


@pytest.mark.parametrize(
    ("value", "text"),
    [(25, "25"), (-3.0, "-3"), (12.5, "12.5"), (-0.0, "0"), (1e-7, "0.0000001"), (1e6, "1000000")],
)
def test_numbers(value: float, text: str) -> None:
    """Numbers are printed without exponent and without needless decimals."""
    assert number_text(value) == text


# Parsing


@pytest.mark.parametrize(
    ("text", "node"),
    [
        ("PatrolWaypoint", PATROL),
        ("selector { PatrolWaypoint }", Node("selector", (), (PATROL,))),
        ("sequence { PatrolWaypoint PickupGarbage }", Node("sequence", (), (PATROL, PICKUP))),
        ("parallel { PickupGarbage }", parallel("all", "one")),
        (
            "parallel success one { PickupGarbage }",
            parallel("one", "one"),
        ),
        (
            "parallel failure all { PickupGarbage }",
            parallel("all", "all"),
        ),
        ("inverter { PatrolWaypoint }", Node("inverter", (), (PATROL,))),
        ("repeater 3 { PatrolWaypoint }", Node("repeater", CountArgs(3), (PATROL,))),
        (
            "when lap >= 2 { PatrolWaypoint }",
            Node("when", GuardArgs(Condition("lap", ">=", 2), "both"), (PATROL,)),
        ),
        ("when lap<-.5{PatrolWaypoint}", None),
        (
            "when lap <-0.5 { PatrolWaypoint }",
            Node("when", GuardArgs(Condition("lap", "<", -0.5), "both"), (PATROL,)),
        ),
        (
            "when foundGarbage abort self { PatrolWaypoint }",
            Node("when", GuardArgs(Condition("foundGarbage", "is", 0), "self"), (PATROL,)),
        ),
        (
            "when not foundGarbage abort none { PatrolWaypoint }",
            Node("when", GuardArgs(Condition("foundGarbage", "not", 0), "none"), (PATROL,)),
        ),
    ],
)
def test_each_kind_of_node(text: str, node: Node | None) -> None:
    """Each form of the language gives its node; None is an error."""
    if node is None:
        with pytest.raises(TreeError):
            parse(text)
    else:
        assert parse(text) == node


def test_subtrees_are_expanded() -> None:
    """A `use` expands to the whole subtree; one that is not used costs nothing."""
    tree = parse(
        "subtree pick = sequence { MoveToGarbage PickupGarbage }\n"
        "subtree twice = selector { use pick use pick }\n"
        "subtree unused = PatrolWaypoint\n"
        "inverter { use twice }"
    )
    pick = "sequence { MoveToGarbage PickupGarbage }"
    assert tree == parse(f"inverter {{ selector {{ {pick} {pick} }} }}")


# Bounds


def nested(levels: int) -> str:
    return "inverter {" * (levels - 1) + "PatrolWaypoint" + "}" * (levels - 1)


def test_largest_tree() -> None:
    """The deepest and the largest tree that the language takes at all."""
    assert depth(parse(nested(MAX_LEVELS))) == MAX_LEVELS
    half = (MAX_NODES - 2) // 2
    doubled = "subtree half = sequence { %s } selector { use half use half }"
    largest = parse(doubled % ("Act " * (half - 1)))
    assert size(largest) == MAX_NODES - 1
    assert parse(to_text(largest)) == largest  # what is printed can be read
    with pytest.raises(LimitError, match="canonical text"):
        parse(doubled % ("PatrolWaypoint " * (half - 1)))


@pytest.mark.parametrize(
    "text",
    [
        nested(MAX_LEVELS + 1),
        f"subtree a = {nested(MAX_LEVELS)} inverter {{ use a }}",
        "subtree a0 = PatrolWaypoint "
        + " ".join(f"subtree a{i + 1} = sequence {{ use a{i} use a{i} }}" for i in range(40))
        + " use a40",
        "PatrolWaypoint" + " " * MAX_CHARACTERS,
    ],
    ids=["nested", "nested by use", "doubling", "long"],
)
def test_limits(text: str) -> None:
    """Trees beyond the bounds are refused as such, with `use` counted expanded."""
    with pytest.raises(LimitError):
        parse(text)


HOSTILE = {
    "a megabyte of brackets": "{" * 1_000_000,
    "100,000 levels": nested(100_000),
    "as many levels as a text can have": nested(8_000),
    "open brackets to the limit": "inverter{" * 11_000,
    "brackets only": "{" * 99_999,
    "a very long word": "A" * 99_999,
    "a very long number": "when lap < " + "9" * 99_000 + " { PatrolWaypoint }",
    "a very long count": "repeater " + "9" * 99_000 + " { PatrolWaypoint }",
    "unknown words to the limit": "selector {" + " Patrol" * 14_000 + "}",
    "many lines": "\n" * 99_000 + "?",
    "many minus signs": "-" * 99_999,
    "nul": "selector { \0 }",
    "lone surrogate": "selector { \ud800 }",
    "right to left": "selector { \u202e }",
    "other digits": "when lap < \u0663 { PatrolWaypoint }",
    "other letters": "s\u0435lector { PatrolWaypoint }",
    "two byte order marks": "\ufeff\ufeffPatrolWaypoint",
    "no-break space": "selector\u00a0{ PatrolWaypoint }",
    "many subtrees": "".join(f"subtree a{i} = PatrolWaypoint " for i in range(3_000)) + "use b",
    "a subtree with a very long name": f"subtree {'a' * 40_000} = PatrolWaypoint {'a' * 40_000}",
    "use of a very long name": f"subtree {'a' * 40_000} = PatrolWaypoint use {'a' * 39_999}",
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_text(text: str) -> None:
    """For any text the answer is a short and clear error, at once."""
    parse("PatrolWaypoint")
    start = time.process_time()
    with pytest.raises(TreeError) as excinfo:
        parse(text, VOCABULARY)
    assert time.process_time() - start < 1
    assert len(str(excinfo.value)) < 1_000
    str(excinfo.value).encode()


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_text_of_any_domain(text: str) -> None:
    """Without a vocabulary a long name is a name; everything else is refused as fast."""
    parse("PatrolWaypoint")
    start = time.process_time()
    node = tree_or_error(text, None)
    assert time.process_time() - start < 1
    if isinstance(node, TreeError):
        assert len(str(node)) < 1_000
    else:
        assert actions(node) == [text.split()[-1]]


@examples(max_examples=300, deadline=None)
@given(st.text(max_size=60))
def test_any_text(text: str) -> None:
    """No text makes the parser raise anything but a TreeError."""
    for vocabulary in (VOCABULARY, None):
        node = tree_or_error(text, vocabulary)
        assert isinstance(node, TreeError) or parse(to_text(node), vocabulary) == node


TOKENS = (
    "domain selector sequence parallel inverter repeater when use subtree not abort self { } = <"
    " 3 x island"
)
any_word = st.sampled_from([*TOKENS.split(), *VOCABULARY.actions, "lap", "foundGarbage"])


@st.composite
def nearly_trees(draw: st.DrawFn) -> list[str]:
    """The words of a tree, of which one has been taken away, doubled or replaced."""
    tokens = to_text(draw(nodes())).split()
    at = draw(st.integers(0, len(tokens) - 1))
    tokens[at : at + 1] = draw(st.sampled_from(([], [tokens[at]] * 2, [draw(any_word)])))
    return tokens


def tree_or_error(text: str, vocabulary: Vocabulary | None = VOCABULARY) -> Node | TreeError:
    """The tree of a text, or its error."""
    try:
        return parse(text, vocabulary)
    except TreeError as error:
        return error


def actions(node: Node) -> list[str]:
    """The names of the actions, from left to right."""
    names = [node.action] if node.kind == "action" else []
    return [*names, *(name for child in node.children for name in actions(child))]


@examples(max_examples=100, deadline=None)
@given(st.lists(any_word) | nearly_trees())
def test_any_words(tokens: list[str]) -> None:
    """The language's own words are a tree of their actions, in order, or an error at a place."""
    text = " ".join(tokens)
    node = tree_or_error(text)
    if isinstance(node, TreeError):
        assert node.line == 1
        assert 1 <= node.column <= len(text) + 1
        return
    assert parse(to_text(node)) == node
    if not {"use", "subtree"} & set(tokens):
        assert actions(node) == [token for token in tokens if token in VOCABULARY.actions]


@examples(max_examples=100, deadline=None)
@given(nodes())
def test_the_words_of_a_tree_are_the_tree(node: Node) -> None:
    """One to a line or all in one."""
    tokens = to_text(node).split()
    assert parse("\n".join(tokens)) == parse(" ".join(tokens)) == node


@pytest.mark.process
def test_lark_is_imported_when_a_text_is_parsed() -> None:
    """Importing the language costs no start-up time: lark comes with the first text."""
    code = "import sys, islandgp.bt.core.language; sys.exit('lark' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_another_lark_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The package lark-parser writes an old parser into the folder of lark."""
    monkeypatch.setattr("lark.__version__", "0.12.0")
    with pytest.raises(ConfigError, match="pip uninstall -y lark-parser"):
        language.parser_of.__wrapped__()
