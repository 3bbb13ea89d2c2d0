"""Keywords are keywords in their places only: elsewhere they are names."""

from __future__ import annotations

import pytest

from islandgp.bt.core.format import format_text
from islandgp.bt.core.kinds import CALLABLE, RESERVED
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.parameters import one_of, real, text
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.errors import TreeError
from tests.bt.test_declarations import grammar_keywords

NAMES = sorted(grammar_keywords() - RESERVED)

PORTS = """<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence><Go timeout="3" success="door"/><Stop/></Sequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Action ID="Go">
      <input_port name="timeout" type="double"/><input_port name="success" type="std::string"/>
    </Action>
    <Action ID="Stop"/>
  </TreeNodesModel>
</root>"""


def everywhere(word: str) -> Vocabulary:
    """A vocabulary with the word as an action, an argument, a value and a word of a key."""
    arguments = {word: one_of("", ("x", word)), "note": text(""), "limit": real("", 0, 9)}
    actions = {word: Action("", arguments=arguments), "Stop": Action("")}
    return Vocabulary(word, actions, {"mode": enumeration("", ["idle", word]), "ready": flag("")})


@pytest.mark.parametrize("word", NAMES)
def test_a_keyword_as_a_name(word: str) -> None:
    """Text, JSON, XML and Python have the tree; so has an expanded subtree of that name."""
    vocabulary = everywhere(word)
    call = f"{word}()" if word in CALLABLE else word
    body = f"sequence {{ {call} {word}({word}: {word}, note: {word}) Stop }}"
    guard = f"when mode == {word} abort lower {{ {body} }}"
    tree = parse(f"domain {word} subtree {word} = {guard} use {word}", vocabulary)
    assert to_text(parse(to_text(tree), vocabulary)) == to_text(tree)
    assert parse(format_text(guard), vocabulary) == tree
    assert read_tree(behaviortree_cpp.to_xml(tree, vocabulary), vocabulary).tree == tree
    assert "mode" in py_trees.to_python(tree, vocabulary)


@pytest.mark.parametrize("word", NAMES)
def test_a_keyword_as_a_key(word: str) -> None:
    """A flag can have any name but the reserved ones, beside the keyword itself."""
    vocabulary = Vocabulary("bot", {"Stop": Action("")}, {word: flag(""), "ready": flag("")})
    text = f"when ({word} or ready) and not {word} abort none {{ retry 3 {{ Stop }} }}"
    tree = parse(text, vocabulary)
    assert parse(to_text(tree), vocabulary) == tree == parse(format_text(text), vocabulary)
    assert read_tree(behaviortree_cpp.to_xml(tree, vocabulary), vocabulary).tree == tree


@pytest.mark.parametrize("word", sorted(RESERVED))
def test_a_reserved_word_as_an_argument(word: str) -> None:
    """Arguments and their values have any name."""
    actions = {"Go": Action("", arguments={word: one_of("", ("x", word))})}
    text = f"Go({word}: {word})"
    assert parse(to_text(parse(text, Vocabulary("bot", actions, {})))) == parse(text)


def test_a_port_of_a_model() -> None:
    """A port of a `TreeNodesModel` can be named like a node."""
    vocabulary = declared(PORTS, PORTS, name="ports.xml")
    text = "sequence { Go(timeout: 3, success: door) Stop }\n"
    assert to_text(read_tree(PORTS, vocabulary).tree) == text


def test_constants_and_parameters() -> None:
    """Their names follow a keyword, an operator or a colon, where no keyword can be."""
    text = "constant wait = 3 subtree retry(none) = timeout none { A(b: wait) } use retry(wait)"
    assert to_text(parse(text)) == "timeout 3 { A(b: 3) }\n"
    text = "subtree f(go) = sequence { go go } use f(timeout(a: 1))"
    assert to_text(parse(text)) == "sequence { timeout(a: 1) timeout(a: 1) }\n"


def test_values_without_quotes() -> None:
    """A text that is a keyword needs no quotes, so a new keyword changes no canonical text."""
    assert to_text(parse('Go(a: "timeout")')) == "Go(a: timeout)\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sequence { timeout }", "a name | a number"),
        ("selector ( Go )", "unexpected '('"),
        ("selector { none self }", "unknown action 'none'"),
        ("when selector { Go }", "unknown blackboard key 'selector'"),
        ("sequence { Go include }", "unknown action 'include'"),
    ],
)
def test_mistakes(text: str, message: str) -> None:
    """A keyword in a wrong place is reported where it is."""
    with pytest.raises(TreeError) as error:
        parse(text, Vocabulary("bot", {"Go": Action("")}, {"ready": flag("")}))
    assert message in str(error.value)
