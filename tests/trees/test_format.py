"""`islandgp fmt`: one form for each file, and nothing that a person wrote is lost."""

from __future__ import annotations

import re
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, parse_placed, parser_of, to_text
from islandgp.bt.core.node import Node, walk
from islandgp.bt.core.parameters import text as text_argument
from islandgp.bt.core.vocabulary import Action, Vocabulary
from tests.composed import composed
from tests.profiles import cases, examples
from tests.strategies import nodes
from tests.trees.shell import Cli
from tests.trees.worlds import random_trees

GAPS = st.sampled_from(
    [" ", "\n", "\n\n", "\n\n\n", "  ", "\t", " # one\n", "\n# two\n", "\n\n#three\n\n"]
)


@st.composite
def files(draw: st.DrawFn) -> str:
    """A right file with any gaps between its words, and perhaps a named subtree."""
    text = to_text(draw(nodes(max_leaves=6)))
    if draw(st.booleans()):
        text = f"subtree part = {to_text(draw(nodes(max_leaves=4)))} selector {{ {text} use part }}"
    tokens = [
        str(token) for token in parser_of().parse_interactive(text, start="library").iter_parse()
    ]
    first = draw(st.sampled_from(["", "\n", "# head\n", "\n\n# head\n\n"]))
    return first + "".join(token + draw(GAPS) for token in tokens)


def comments(text: str) -> list[str]:
    return [comment.rstrip() for comment in re.findall(r"#[^\n]*", text)]


@examples(max_examples=120)
@given(text=files())
def test_formatting(text: str) -> None:
    """The tree is the same, all comments are there in their order, and fmt of fmt is fmt."""
    formatted = format_text(text)
    assert parse(formatted) == parse(text)
    assert comments(formatted) == comments(text)
    assert format_text(formatted) == formatted
    assert "\n\n\n" not in formatted
    assert not re.search(r"[ \t]\n", formatted)


def test_a_long_condition_is_broken() -> None:
    """Before its `and`s or `or`s; doing it again changes nothing."""
    condition = " and ".join(["batteryLevel < 20"] * 6)
    text = format_text(f"selector {{ when {condition} {{ SeekCharger }} PatrolWaypoint }}")
    assert "  when batteryLevel < 20\n      and batteryLevel < 20\n" in text
    assert max(map(len, text.splitlines())) <= 80
    assert format_text(text) == text


def test_random_trees() -> None:
    """For random trees parse of print is the identity, and fmt prints what the printer does."""
    for tree in random_trees(composed(), cases(500)):
        text = to_text(tree)
        assert parse(text) == tree
        assert format_text(text) == text
        assert format_text(text.replace("\n", "\r\n")) == text


@examples(max_examples=100)
@given(tree=nodes())
def test_places_are_those_of_the_nodes(tree: Node) -> None:
    """Each node of the expanded tree has the place of its word in the text."""
    text = to_text(tree)
    lines = text.split("\n")
    placed = parse_placed(text)
    assert placed.node == tree
    for node, (line, column, *_) in zip(walk(tree), placed.places, strict=True):
        word = node.args[0] if node.kind == "action" else node.kind
        assert lines[line - 1][column - 1 :].startswith(str(word))


MESSY = """\
# All of it.
subtree   go=PatrolWaypoint # the round
selector{ # in order
    # first of all
  when batteryLevel<25.0 abort both { SeekCharger } # why


  when # odd place
    foundGarbage
  { MoveToGarbage }
  use go # else
  # that is all
}
# the end
"""
TIDY = """\
# All of it.
subtree go = PatrolWaypoint  # the round

selector {  # in order
  # first of all
  when batteryLevel < 25 { SeekCharger }  # why

  # odd place
  when foundGarbage { MoveToGarbage }
  use go  # else
  # that is all
}
# the end
"""


def test_by_hand() -> None:
    """Comments stay in their places, subtrees keep their names, defaults go."""
    assert format_text(MESSY) == TIDY


def test_command(islandgp: Cli, tmp_path: Path) -> None:
    """fmt writes what would change, and only that; --check writes nothing."""
    messy, tidy = tmp_path / "messy.bt", tmp_path / "tidy.bt"
    messy.write_text(MESSY)
    tidy.write_text(TIDY)
    checked = islandgp("fmt", "--check", messy, tidy)
    assert (checked.code, messy.read_text()) == (1, MESSY)
    assert "messy.bt" in checked.err
    assert "tidy.bt" not in checked.err
    formatted = islandgp("fmt", messy, tidy)
    assert (formatted.code, messy.read_text(), tidy.read_text()) == (0, TIDY, TIDY)
    assert islandgp("fmt", "--check", messy).code == 0


def test_standard_input(islandgp: Cli) -> None:
    """`-` formats the standard input; what is no tree is an error and exit code 2."""
    assert islandgp("fmt", "-", stdin=MESSY).out == TIDY
    refused = islandgp("fmt", "-", stdin="selector {")
    assert refused.code == 2
    assert refused.err.startswith("islandgp: <stdin>:1:11: the text ends too early")


SPEAKER = Vocabulary("robot", {"Say": Action("", arguments={"what": text_argument("")})}, {})


def test_texts_keep_their_quotes_beside_constants_and_parameters() -> None:
    """Without its quotes a text would become the constant or the parameter of the same name."""
    text = """\
constant low = 3
subtree say(word) = sequence { Say(what: "word") Say(what: word) Say(what: "low") }
sequence { use say("low") Say(what: "open") }
"""
    tidy = format_text(text)
    assert parse(tidy, SPEAKER) == parse(text, SPEAKER)
    assert format_text(tidy) == tidy
    assert "Say(what: open)" in tidy
    plain = parse(text)  # its canonical text has no constants, and needs no quotes
    assert parse(to_text(plain)) == plain
