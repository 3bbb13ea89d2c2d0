"""The generated grammar: all its texts are valid trees, and canonical trees are texts of it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.kinds import ABORTS, INNER
from islandgp.bt.core.language import MAX_CHARACTERS, parse, to_text
from islandgp.bt.core.node import Limits, check_limits
from islandgp.bt.core.parameters import one_of, real, switch, text, whole
from islandgp.bt.core.printer import number_text
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration, flag, integer, number
from islandgp.bt.export.grammar import Grammar, between, tree_grammar
from islandgp.commands.trees import grammar_command as command
from islandgp.errors import DomainError
from islandgp.gp.random_trees import TreeSettings, TreeSpace, random_tree
from islandgp.installed import domain_class
from islandgp.resources import resource
from studies.controls.grammar_walk import random_text
from tests.profiles import cases, sweep

DEPTH = 5
BOT = Vocabulary(
    "bot",
    {
        "MoveTo": Action(
            "goes there",
            arguments={
                "goal": one_of("where to", ("dock", "door", "bin")),
                "speed": real("how fast", 0.1, 1.0, default=0.5, unit="m/s"),
                "turn": real("angle", -3.25, 7.5),
                "tries": whole("how often", 1, 15),
                "loud": switch("with the horn"),
                "frame": text("of the map"),
            },
        ),
        "Stop": Action("stops"),
    },
    {
        "near": flag("at the goal"),
        "range": number("m", 0, 5),
        "left": number("m", -5, 5),
        "count": integer("items", 0, 9),
        "mode": enumeration("of the robot", ("idle", "busy")),
        "wish": enumeration("of the user", ("idle", "busy")),
    },
)
"""Each kind of key and of argument."""


@cache
def vocabularies() -> dict[str, Vocabulary]:
    return {"bot": BOT, "island": domain_class("island", None).schema.vocabulary}


@cache
def grammar(name: str) -> Grammar:
    return tree_grammar(vocabularies()[name], DEPTH)


def accepts(grammar: Grammar, text: str) -> bool:
    """Whether a text is one of the grammar: the ends of each rule at each place, each once."""
    patterns = {name: re.compile(pattern) for name, pattern in grammar.patterns.items()}

    @cache
    def ends(name: str, at: int) -> frozenset[int]:
        if name.startswith('"'):
            literal = name[1:-1].replace("\\n", "\n").replace('\\"', '"')
            return frozenset({at + len(literal)} if text.startswith(literal, at) else ())
        if name in patterns:
            last = min(len(text), at + 80)
            return frozenset(
                e for e in range(at, last + 1) if patterns[name].fullmatch(text, at, e)
            )
        found: set[int] = set()
        for parts in grammar.rules[name]:
            places = {at}
            for part in parts:
                places = {end for place in places for end in ends(part, place)}
            found |= places
        return frozenset(found)

    return len(text) in ends(next(iter(grammar.rules)), 0)


@pytest.mark.parametrize("name", ["bot", "island"])
def test_every_text_of_the_grammar_is_a_valid_tree(name: str) -> None:
    """Walks over the rules: names, arguments, ranges, conditions and the depth are right."""
    rng = np.random.default_rng(0)
    kinds = set()
    for _ in range(cases(100)):
        text = random_text(grammar(name), rng)
        tree = parse(text, vocabularies()[name])
        check_limits(tree, Limits(DEPTH, 10_000))
        kinds.add(tree.kind)
    assert len(kinds) > 4


DEEP = re.compile(r"\((?=[^()]* and )(?=[^()]* or )[^()]*\)")
"""A condition in brackets that joins by both words: its third level."""


def mixed(text: str) -> bool:
    """True for a condition with brackets and more than four terms beside them."""
    return any(
        "(" in line and len(re.findall(r" (?:and|or) ", re.sub(r"\([^()]*\)", "", line))) > 3
        for line in text.splitlines()
        if "when" in line
    )


@pytest.mark.parametrize("name", ["bot", "island"])
def test_every_canonical_tree_is_a_text_of_the_grammar(name: str) -> None:
    """Those of the grammar's own texts and of evolution, in the printer's lines and indents."""
    rng, vocabulary = np.random.default_rng(1), vocabularies()[name]
    settings = TreeSettings(
        depth=(2, DEPTH),
        leaf=0.3,
        children=(1, 4),
        repeats=100,
        kinds=dict.fromkeys(INNER, 1.0),
        operators=dict.fromkeys(OPERATORS, 1.0),
        aborts=dict.fromkeys(ABORTS, 1.0),
    )
    limits = Limits(DEPTH, 30)
    space = TreeSpace(settings, vocabulary, limits)
    for _ in range(cases(100)):
        drawn = parse(random_text(grammar(name), rng), vocabulary)
        for tree in (drawn, random_tree(rng, space)):
            text = to_text(tree)
            # The grammar has texts in quotes only, and conditions of two levels.
            if not re.search(r"frame: \w", text) and not DEEP.search(text) and not mixed(text):
                assert accepts(grammar(name), text), text


def test_hand_written_trees_are_texts_of_the_grammar() -> None:
    """The shipped trees of the island, with their subtrees expanded."""
    vocabulary = vocabularies()["island"]
    trees = [*(resource("grammar") / "examples").glob("*.bt")]
    for path in trees:
        text = to_text(parse(path.read_text(encoding="utf-8"), vocabulary, folder=path.parent))
        assert accepts(tree_grammar(vocabulary, 8), text), path


@pytest.mark.parametrize("wrong", [
    "MoveTo(goal: roof)", "MoveTo(speed: 1.01)", "MoveTo(tries: 16)", "Fly",
    "when mode < 3 { Stop }",
    "when near > 1 { Stop }", "when range { Stop }", "repeater 101 { Stop }", "sequence { }",
    "when mode == near { Stop }", "wait 0 { Stop }", "sequence { Stop",
])  # fmt: skip
def test_what_check_rejects_is_no_text_of_the_grammar(wrong: str) -> None:
    """Names, ranges and forms that do not fit."""
    assert not accepts(grammar("bot"), wrong)
    assert accepts(grammar("bot"), "sequence { Stop }")


@given(
    st.floats(-1000, 1000), st.floats(0.001, 1000), st.floats(-1.2, 2.2), st.booleans(),
)  # fmt: skip
def test_a_pattern_has_the_numbers_of_a_range_and_no_others(
    low: float, width: float, share: float, whole: bool
) -> None:
    """At the ends, between and outside, with and without decimals."""
    low, high = round(low, 3), round(low + width, 3)
    if whole:
        low, high = float(round(low)), float(round(high) + 1)
    pattern = re.compile(between(low, high, whole=whole))
    inside = round(low + share * width, 4)
    for value in (low, high, inside, float(round(inside))):
        expected = low <= value <= high and (not whole or value == int(value))
        if value:
            assert bool(pattern.fullmatch(number_text(value))) == expected, value


def masked_walks(grammar: str, number: int, rng: np.random.Generator) -> Iterator[str]:
    """Texts by the masks of llguidance over single bytes."""
    llguidance = pytest.importorskip("llguidance")

    class Bytes:
        eos_token_id, bos_token_id = 256, None
        tokens = (*(bytes([i]) for i in range(256)), b"<end>")
        special_token_ids = (256,)

        def __call__(self, text: bytes) -> list[int]:
            return list(text)

    tokenizer = llguidance.LLTokenizer(llguidance.TokenizerWrapper(Bytes()), slices=[])
    matcher = llguidance.LLMatcher(tokenizer, grammar)
    for _ in range(number):
        walked = bytearray()
        while not matcher.is_stopped():
            if forced := matcher.compute_ff_bytes():
                tokens = list(forced)
            else:
                mask = np.frombuffer(matcher.compute_bitmask(), np.uint8)
                allowed = np.flatnonzero(np.unpackbits(mask, bitorder="little")[:257])
                tokens = [int(rng.choice(allowed))]
            if tokens == [256]:
                break
            matcher.consume_tokens(tokens)
            walked += bytes(tokens)
        assert not matcher.is_error(), matcher.get_error()
        yield walked.decode()
        matcher.reset()


@sweep(
    ("name", "notation", "seed"),
    [(n, f, i) for n in ("bot", "island") for f in ("lark", "gbnf") for i in range(20)],
    quick=0,
)
def test_random_walks_by_a_decoders_masks_are_valid(name: str, notation: str, seed: int) -> None:
    """As a model without judgement decodes them: 10,000 for each notation."""
    pytest.importorskip("llguidance")
    text, rng = grammar(name).text(notation), np.random.default_rng(seed)
    if notation == "gbnf":
        text = import_module("llguidance.gbnf_to_lark").any_to_lark(text)
    valid = 0
    for walked in masked_walks(text, 250, rng):
        if len(walked) < MAX_CHARACTERS / 10:  # the number of children is open
            parse(walked, vocabularies()[name])
            valid += 1
    assert valid >= 200  # some have too many children to be read


def test_the_command_prints_both_notations() -> None:
    """To the terminal or a file; a faulty word is an error in one line."""
    for notation, first in (("lark", "start : node8"), ("gbnf", "root ::= node8")):
        result = CliRunner().invoke(command, ["--domain", "island", "--format", notation])
        assert result.exit_code == 0
        assert result.output.startswith(first)
        assert result.output == tree_grammar(vocabularies()["island"], 8).text(notation)


def test_a_vocabulary_without_actions_has_no_grammar() -> None:
    """There is no tree without an action."""
    with pytest.raises(DomainError, match="Expected an action in the vocabulary of nothing"):
        tree_grammar(Vocabulary("nothing", {}, {}), 3)
