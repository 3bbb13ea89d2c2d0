"""Errors of texts that the grammar does not accept, and the words that can follow a text."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parser_of
from islandgp.bt.core.source import Source, Word, closest, plain, shown
from islandgp.bt.core.unknown import FOREIGN_WORDS, NODE, unknown, unknown_node
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary
from islandgp.errors import TreeError

if TYPE_CHECKING:
    from lark import Token
    from lark.exceptions import UnexpectedInput

_COMMENT: Final = "#, which begins a comment"
_BLANK: Final = "a blank, which separates nodes"
_SIGNS: Final = (
    ("&", "", "and"), ("|", "", "or"), ("!", "", "not"), ("/", "", _COMMENT),
    ("=>", "", ">="), ("=<", "", "<="), (";", "", _BLANK), ("'", "", '"'),
    ("%", "", "a number without a unit"),
    ("\N{LESS-THAN OR EQUAL TO}", "", "<="), ("\N{GREATER-THAN OR EQUAL TO}", "", ">="),
    ("\N{NOT EQUAL TO}", "", "!="), ("\N{MINUS SIGN}", "", "-"), ("\N{EN DASH}", "", "-"),
    ("\N{LEFT DOUBLE QUOTATION MARK}", "", '"'), ("\N{RIGHT DOUBLE QUOTATION MARK}", "", '"'),
    ("=", "OPERATOR", "=="), ("is", "OPERATOR", "=="), ("=", "COLON", ":"), (",", "RBRACE", _BLANK),
    ("[", "LBRACE", "{"), ("]", "RBRACE", "}"),
    ("{", "COMMA", "a `use` of a subtree that is defined above"),
)  # fmt: skip
"""Signs of other languages, where a terminal is accepted ("": anywhere), with the correct form."""

_SPELLING: Final = {
    "NUMBER": "a number", "LBRACE": "{", "RBRACE": "}", "EQUAL": "=", "LPAR": "(", "RPAR": ")",
    "LSQB": "[", "RSQB": "]", "NAME": "a name",
    "COMMA": ",", "COLON": ": after the argument's name", "FILE": "a text in quotes",
    "$END": "the end of the text", "OPERATOR": " ".join(OPERATORS),
}  # fmt: skip
"""What the parser's terminals look like in a text, unless it is their name."""

_SELDOM: Final = frozenset({"PLUS", "MINUS", "TIMES", "DIVIDE"})
"""Terminals that are not listed, as they are seldom meant."""

_FULL: Final = {
    frozenset({"RBRACE"}): "this node takes no more children; wrap several in a sequence",
    frozenset({"$END"}): "a file holds one tree, after its subtrees",
}
"""What is to be said where only one terminal is accepted."""


def following(text: str, rule: str = "library") -> frozenset[str]:
    """The terminals of the grammar that can follow a text; none if the text is not valid."""
    from lark.exceptions import UnexpectedInput

    interactive = parser_of().parse_interactive(plain(text), start=rule)
    try:
        interactive.exhaust_lexer()
    except UnexpectedInput:
        return frozenset()
    return frozenset(interactive.accepts())  # type: ignore[no-untyped-call] # lark types it not


def syntax_error(
    source: Source, error: UnexpectedInput, rule: str, vocabulary: Vocabulary | None
) -> TreeError:
    """The error for a text that the grammar doesn't accept.

    Args:
        source: the text.
        error: of the parser.
        rule: of the grammar, for the whole text.
        vocabulary: the domain's words; None: any name could be one.
    """
    token = getattr(error, "token", None)  # None: a character that begins no word
    start = error.pos_in_stream or 0
    if token is not None and token.type == "$END":
        start = len(source.text)
    # A word that touches a wrong character is a part of what is wrong.
    before = _words_before(source, start + (token is not None), rule)
    if vocabulary and (of_name := _unknown_before(source, before, vocabulary)):
        return of_name
    end = (before[-1].end_pos or 0) if before else 0
    accepted = following(source.text[:end], rule) - _SELDOM
    expected, candidates = _expected(accepted, vocabulary or EMPTY_VOCABULARY)
    if token is not None and token.type == "$END":
        message = "the text ends too early" if before else "the text is empty"
        if open_brace := _open_brace(before):
            message += f": the brace in line {open_brace.line} is not closed"
        at = (before[-1].end_line, before[-1].end_column) if before else (1, 1)
        return source.error(at, message, expected)
    rest = source.text[start:]
    found = token or rest[:1]
    message = f"unexpected {shown(found)}"
    if len(found) == 1 and not found.isascii():  # a sign that looks like another one
        message += f" (U+{ord(found):04X})"
    if hint := _FULL.get(accepted - {"LPAR"}):
        message += f"; {hint}"
    guesses = [good for bad, at, good in _SIGNS if rest.startswith(bad) and {at} <= {"", *accepted}]
    guesses += [FOREIGN_WORDS.get(found.lower(), "") or closest(found.strip('"'), candidates)]
    return source.error((error.line, error.column), message, expected, guess=guesses[0])


def _words_before(source: Source, end: int, rule: str) -> list[Token]:
    """The words of a text with a fault that end before a place."""
    from lark.exceptions import UnexpectedInput

    words: list[Token] = []
    with suppress(UnexpectedInput):  # the fault itself
        words.extend(parser_of().parse_interactive(source.text, start=rule).iter_parse())
    return [word for word in words if word.type != "$END" and (word.end_pos or 0) < end]


def _unknown_before(
    source: Source, before: Sequence[Token], vocabulary: Vocabulary
) -> TreeError | None:
    """The error for an unknown name before the fault, the likelier cause: `slector { ... }`."""
    subtrees = [str(name) for previous, name in pairwise(before) if previous == "subtree"]
    for word in before[-3:]:
        accepted = following(source.text[: word.start_pos]) if word.type == "NAME" else ()
        if "SELECTOR" in accepted and word not in vocabulary.actions:
            return unknown_node(Word(word, source), subtrees, vocabulary, ())
        if "NOT" in accepted and word not in vocabulary.keys:
            return unknown(Word(word, source), "blackboard key", vocabulary.keys)
    return None


def _open_brace(before: Sequence[Token]) -> Token | None:
    """The last brace that is not closed."""
    braces: list[Token] = []
    for token in before:
        if token == "{":
            braces.append(token)
        elif token == "}":
            braces.pop()
    return braces[-1] if braces else None


def _expected(accepted: frozenset[str], vocabulary: Vocabulary) -> tuple[str, Sequence[str]]:
    """The accepted words, as a text and as candidates for a correction."""
    spelled = [_SPELLING.get(name, name.lower()) for name in sorted(accepted)]
    if "SELECTOR" in accepted:
        return "} or " * ("RBRACE" in accepted) + NODE, [*spelled, *KINDS, *vocabulary.actions]
    if "NOT" in accepted:
        return f"a key: {', '.join(vocabulary.keys)}, not or (", [*vocabulary.keys]
    if "USE" in accepted:
        return "a number, a key, a word, a text in quotes, an action or a `use`", ()
    return " | ".join(spelled), spelled
