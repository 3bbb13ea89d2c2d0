"""The tables of `node.py` against everything that is made from them or speaks of them."""

from __future__ import annotations

import re

import pytest
from lark import Lark

from islandgp.bt import node
from islandgp.bt.language import parse, to_text
from islandgp.bt.node import ABORTS, ACTIONS, KEYS, KINDS, OPERATORS, POLICIES, Action, Key, Node
from islandgp.resources import resource

OTHER_WORDS = {"subtree", "use", "not", "abort", "success", "failure"}


def grammar_words() -> set[str]:
    grammar = Lark((resource("grammar") / "bt.lark").read_text(encoding="utf-8"), parser="lalr")
    patterns = (terminal.pattern for terminal in grammar.terminals)
    return {p.value for p in patterns if p.type == "str" and p.value.isalpha()}


def test_grammar_has_the_words_of_the_tables() -> None:
    """The grammar's words are the node kinds, the abort rules, the policies, and six more."""
    kinds = set(KINDS) - {"action"}
    assert grammar_words() == kinds | set(ABORTS) | set(POLICIES) | OTHER_WORDS


def test_grammar_lists_no_names() -> None:
    """Actions and keys are declared in the tables alone, so that adding one is one entry."""
    text = (resource("grammar") / "bt.lark").read_text(encoding="utf-8")
    rules = re.sub(r"//.*", "", text)
    assert [name for name in (*ACTIONS, *KEYS) if name in rules] == []


def test_names_are_no_words_of_the_grammar() -> None:
    """An action or key that is spelled like a word of the language could not be said."""
    assert grammar_words() & {*ACTIONS, *KEYS} == set()
    assert all(re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) for name in (*ACTIONS, *KEYS))
    assert set(ACTIONS) & set(KEYS) == set()


def test_operators_can_be_said() -> None:
    """Every operator of the table is one of the grammar, and the other way round."""
    for operator in OPERATORS:
        assert parse(f"when lap {operator} 1 {{ PatrolWaypoint }}").args[1] == operator
    pattern = re.search(
        r"^OPERATOR: /(.*)/$", (resource("grammar") / "bt.lark").read_text(encoding="utf-8"), re.M
    )
    assert pattern is not None
    both = {a + b for a in "<>=!" for b in ["", "="]}
    assert {o for o in both if re.fullmatch(pattern[1], o)} == set(OPERATORS)


def test_a_new_action_is_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    """An action that is added to the table can be parsed and printed at once."""
    monkeypatch.setitem(ACTIONS, "Wave", Action("waves"))
    assert (
        to_text(parse("sequence { Wave PatrolWaypoint }")) == "sequence { Wave PatrolWaypoint }\n"
    )


def test_a_new_key_is_one_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    """A key that is added to the table can be asked for at once."""
    monkeypatch.setitem(KEYS, "wind", Key(False, 0, 12, 1, "wind force"))
    assert (
        to_text(parse("when wind > 7 { PatrolWaypoint }")) == "when wind > 7 { PatrolWaypoint }\n"
    )


@pytest.mark.parametrize("kind", KINDS)
def test_arguments_are_as_declared(kind: str) -> None:
    """A parsed node has the arguments that its kind declares, and its number of children."""
    examples = {
        "action": "PatrolWaypoint",
        "repeater": "repeater 2 { PatrolWaypoint }",
        "when": "when lap > 1 { PatrolWaypoint }",
    }
    parsed = parse(examples.get(kind, f"{kind} {{ PatrolWaypoint }}"))
    fewest, most = KINDS[kind].children
    assert parsed.kind == kind
    assert len(parsed.args) == len(KINDS[kind].args)
    assert fewest <= len(parsed.children) <= most


def test_walk_size_and_depth() -> None:
    """A walk visits parents before children; size counts nodes, depth counts levels."""
    tree = parse("selector { inverter { PatrolWaypoint } PickupGarbage }")
    assert [n.kind for n in node.walk(tree)] == ["selector", "inverter", "action", "action"]
    assert (node.size(tree), node.depth(tree)) == (4, 3)
    assert (node.size(Node("action", ("x",))), node.depth(Node("action", ("x",)))) == (1, 1)
