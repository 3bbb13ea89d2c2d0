"""Words for a text that is not a tree: what stands there, what could, what was probably meant."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from itertools import pairwise, takewhile
from typing import TYPE_CHECKING

from islandgp.bt.node import ACTIONS, KEYS, KINDS, OPERATORS
from islandgp.bt.source import Source, closest, shown
from islandgp.errors import TreeError, UnknownNameError

if TYPE_CHECKING:
    from lark import Token
    from lark.exceptions import UnexpectedInput

_NODE_WORDS = (*(kind for kind in KINDS if kind != "action"), "use")

# What the parser's terminals look like in a text.
_SPELLING = {
    "NUMBER": "a number",
    "LBRACE": "{",
    "RBRACE": "}",
    "EQUAL": "=",
    "$END": "the end of the text",
}


def unknown_key(source: Source, token: Token) -> TreeError:
    """The error for a `when` that asks for something which is not on the blackboard."""
    return source.error_at(
        token,
        f"unknown blackboard key {shown(token)}",
        expected=f"a key: {', '.join(KEYS)}",
        guess=closest(token, KEYS),
        kind=UnknownNameError,
    )


def unknown_node(source: Source, token: Token, subtrees: Collection[str]) -> TreeError:
    """The error for a word that stands where a node is expected and is none."""
    if token in subtrees and closest(token, subtrees):
        guess = f"use {token}"
    elif token in KEYS:
        guess = f"when {token} {{ ... }}" if KEYS[token].flag else f"when {token} < 5 {{ ... }}"
    else:
        guess = closest(token, (*_NODE_WORDS, *ACTIONS))
    what = "node" if source.text[token.end_pos :].lstrip().startswith("{") else "action"
    return source.error_at(
        token,
        f"unknown {what} {shown(token)}",
        expected=_node_words(),
        guess=guess,
        kind=UnknownNameError,
    )


def syntax_error(source: Source, error: UnexpectedInput, words: Iterator[Token]) -> TreeError:
    """The error for a text that the grammar doesn't accept.

    Args:
        source: the text.
        error: what the parser says.
        words: the words of the text, read up to the fault.
    """
    from lark.exceptions import UnexpectedToken

    before = _words_before(words, error)
    subtrees = {str(word) for previous, word in pairwise(before) if previous == "subtree"}
    for previous, word in zip(["", *before], before, strict=False):
        # A name that doesn't exist is the likelier cause than what came of it:
        # in `slector { ... }` the parser takes offence at the brace.
        if word.type == "NAME" and previous not in ("subtree", "use"):
            if previous in ("when", "not") and word not in KEYS:
                return unknown_key(source, word)
            if previous not in ("when", "not") and word not in ACTIONS:
                return unknown_node(source, word, subtrees)
    if not isinstance(error, UnexpectedToken):
        character = source.text[error.pos_in_stream or 0]
        message = f"unexpected character {character!r} (U+{ord(character):04X})"
        return source.error(message, error.line, error.column)
    if error.token.type == "$END":
        return _unexpected_end(source, before, error.accepts)
    return _unexpected_word(source, error.token, before, error.accepts)


def _words_before(words: Iterator[Token], error: UnexpectedInput) -> list[Token]:
    """The words before the fault; at a wrong character, those that don't touch it."""
    from lark.exceptions import UnexpectedCharacters, UnexpectedToken

    if isinstance(error, UnexpectedToken):
        if error.token.type == "$END":  # its position is that of the last word
            return list(words)
        return list(takewhile(lambda word: word.start_pos != error.pos_in_stream, words))
    found: list[Token] = []
    with suppress(UnexpectedCharacters):  # the fault itself
        found.extend(word for word in words if word.end_pos != error.pos_in_stream)
    return found


def _unexpected_end(
    source: Source, before: Sequence[Token], accepted: Collection[str]
) -> TreeError:
    """Points behind the last word."""
    if not before:
        expected, _ = _expected(accepted, previous="")
        return source.error("there is no tree in the text", 1, 1, expected=expected)
    last = before[-1]
    expected, _ = _expected(accepted, previous=str(last))
    line, column = last.end_line or 1, last.end_column or 1
    return source.error("the text ends too early", line, column, expected=expected)


def _unexpected_word(
    source: Source, token: Token, before: Sequence[Token], accepted: Collection[str]
) -> TreeError:
    previous = str(before[-1]) if before else ""
    expected, words = _expected(accepted, previous)
    message = f"unexpected {shown(token)}"
    if accepted == {"RBRACE"}:
        message += "; this node takes one child, so wrap several in a sequence or a selector"
    elif accepted == {"$END"}:
        message += "; a file holds one tree, after its subtrees"
    elif accepted == {"NAME"} and previous == "subtree":
        message += ", a word of the language, so it can't name a subtree"
    guess = "==" if token == "=" and "==" in words else closest(token, words)
    return source.error_at(token, message, expected=expected, guess=guess)


def _expected(accepted: Collection[str], previous: str) -> tuple[str, tuple[str, ...]]:
    """What would have been taken: for people, and as words to guess from."""
    if "SELECTOR" in accepted:
        words = (*(["subtree"] if "SUBTREE" in accepted else []), *_NODE_WORDS, *ACTIONS)
        return ("} or " if "RBRACE" in accepted else "") + _node_words(), words
    if "NAME" in accepted:
        if previous in ("subtree", "use"):
            return "the name of a subtree", ()
        words = ("not", *KEYS) if "NOT" in accepted else tuple(k for k in KEYS if KEYS[k].flag)
        return f"a key: {', '.join(words)}", words
    spelled: list[str] = []
    for name in sorted(accepted, key=lambda name: (name in _SPELLING, name)):
        if name == "OPERATOR":
            spelled += OPERATORS
        else:
            spelled.append(_SPELLING.get(name, name.lower()))
    return ("one of: " if len(spelled) > 1 else "") + " ".join(spelled), tuple(spelled)


def _node_words() -> str:
    return f"a node ({', '.join(_NODE_WORDS)}) or an action ({', '.join(ACTIONS)})"
