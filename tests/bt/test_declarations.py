"""The table of `kinds.py` and the words of vocabularies against the grammar and its parser."""

from __future__ import annotations

import re

import pytest

from islandgp.bt.core import node
from islandgp.bt.core.condition import OPERATORS, Condition
from islandgp.bt.core.kinds import COUNTED, KEYWORDS, KINDS, TIMED
from islandgp.bt.core.language import parse, parser_of, to_text
from islandgp.bt.core.node import leaf
from islandgp.bt.core.vocabulary import RESERVED, Action, Vocabulary, number
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import UnknownNameError
from islandgp.resources import resource

NAMES = (*VOCABULARY.actions, *VOCABULARY.keys)


def grammar_keywords() -> set[str]:
    patterns = (terminal.pattern for terminal in parser_of().terminals)
    words = {p.value for p in patterns if p.type == "str" and p.value.isidentifier()}
    return words | {*KEYWORDS}


def test_grammar_lists_no_names() -> None:
    """Actions and keys are declared by a domain alone, so that adding one is one entry."""
    text = (resource("grammar") / "bt.lark").read_text(encoding="utf-8")
    rules = re.sub(r"//.*", "", text)
    assert [name for name in NAMES if name in rules] == []


def test_reserved_words_are_those_of_the_grammar() -> None:
    """A vocabulary refuses some keywords; `test_keywords` shows that all others are names."""
    assert grammar_keywords() > RESERVED


def test_operators_are_in_the_grammar() -> None:
    """Every operator of the table is one of the grammar, and the other way round."""
    for operator in OPERATORS:
        expr = parse(f"when lap {operator} 1 {{ PatrolWaypoint }}").args[0]
        assert expr == Condition("lap", operator, 1.0)
    pattern = re.search(
        r"^OPERATOR: /(.*)/$", (resource("grammar") / "bt.lark").read_text(encoding="utf-8"), re.M
    )
    assert pattern is not None
    both = {a + b for a in "<>=!" for b in ["", "="]}
    assert {o for o in both if re.fullmatch(pattern[1], o)} == set(OPERATORS)


def test_a_new_action_and_a_new_key_are_an_entry_each() -> None:
    """What a vocabulary declares can be parsed and printed at once, with no other change."""
    vocabulary = Vocabulary(
        "island",
        {**VOCABULARY.actions, "Wave": Action("waves")},
        {**VOCABULARY.keys, "wind": number("wind force", 0, 12)},
    )
    text = "sequence {\n  Wave\n  when wind > 7 { PatrolWaypoint }\n}\n"
    assert to_text(parse(text, vocabulary)) == text
    with pytest.raises(UnknownNameError, match="Wave"):
        parse(text, VOCABULARY)


@pytest.mark.parametrize("kind", KINDS)
def test_arguments_are_as_declared(kind: str) -> None:
    """A parsed node has the arguments that its kind declares, and its number of children."""
    examples = {
        "action": "PatrolWaypoint",
        **{k: f"{k} 2 {{ PatrolWaypoint }}" for k in (*COUNTED, *TIMED)},
        "always": "always success",
        "set": "set lap = lap + 1",
        "if_else": "if_else { PatrolWaypoint PatrolWaypoint }",
        "recovery": "recovery 2 { PatrolWaypoint PatrolWaypoint }",
        "when": "when lap > 1 { PatrolWaypoint }",
    }
    parsed = parse(examples.get(kind, f"{kind} {{ PatrolWaypoint }}"))
    fewest, most = KINDS[kind].children
    assert parsed.kind == kind
    assert kind == "action" or len(parsed.args) == len(KINDS[kind].arguments)
    assert isinstance(parsed.args, KINDS[kind].args)
    assert fewest <= len(parsed.children) <= most


def test_walk_size_and_depth() -> None:
    """A walk visits parents before children; size counts nodes, depth counts levels."""
    tree = parse("selector { inverter { PatrolWaypoint } PickupGarbage }")
    assert [n.kind for n in node.walk(tree)] == ["selector", "inverter", "action", "action"]
    assert (node.size(tree), node.depth(tree)) == (4, 3)
    assert (node.size(leaf("x")), node.depth(leaf("x"))) == (1, 1)
