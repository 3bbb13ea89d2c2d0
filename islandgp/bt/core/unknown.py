"""Errors of names in trees: what was found, what is known there, and a likely correction."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from textwrap import shorten
from typing import Final

from islandgp.bt.core.kinds import KEYWORDS, SHORT
from islandgp.bt.core.source import Word, closest, shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError, UnknownNameError

FOREIGN_WORDS: Final = {
    "fallback": "selector", "priority": "selector", "reactivefallback": "reactive_selector",
    "if": "when", "while": "when", "guard": "when", "condition": "when", "ifthenelse": "if_else",
    "loop": "repeater", "foreach": "for", "delay": "wait", "sleep": "wait", "invert": "inverter",
    "retryuntilsuccessful": "retry", "ratecontroller": "every", "pipelinesequence": "pipeline",
    "subtree": "use", "subtreeplus": "use", "const": "constant", "def": "subtree",
    **dict.fromkeys(("else", "elif", "elseif"), "selector { when ... { ... } ... }"),
}  # fmt: skip
"""Keywords of other languages, with the correct form."""

NODE: Final = "a node or an action"
_LONGEST_GUESS: Final = 100  # most characters of a correction


def unknown(
    word: Word,
    what: str,
    known: Iterable[str],
    *,
    of: str = "",
    expected: str = "",
    guess: str = "",
) -> TreeError:
    """The error for an unknown name.

    Args:
        word: the name.
        what: it should be, e.g. "subtree".
        known: the names of these there.
        of: the name of what should have it.
        expected: what is expected, if it is not one of `known`.
        guess: a likely correction; "": the closest of `known`.
    """
    names = [*known]
    message = f"unknown {what} {shown(word.token)}{f' of {of}' * bool(of)}"
    expected = expected or f"a {what}: {listing(names)}"
    guess = guess[:_LONGEST_GUESS] or closest(word.text, names)
    return word.error(message, expected, guess=guess, kind=UnknownNameError)


def listing(names: Iterable[str]) -> str:
    """Names as a text of limited length."""
    return shorten(", ".join(names), 200, placeholder=" ...") or "none so far"


def unknown_node(
    word: Word, subtrees: Collection[str], vocabulary: Vocabulary, parameters: Collection[str]
) -> TreeError:
    """The error for a word that is not a node, where a node is expected."""
    name, rest = word.text, word.source.text[word.token.end_pos :].lstrip()
    guess = FOREIGN_WORDS.get(name.lower(), "")
    if rest.startswith("="):
        guess = f"constant {name}"
    elif name in subtrees:
        guess = f"use {name}"
    elif name in vocabulary.keys:
        guess = f"when {vocabulary.keys[name].example(name)} {{ ... }}"
    kind = "node" if rest.startswith("{") else "action"
    guess = guess or closest(name, [*KEYWORDS, *SHORT, "use", *vocabulary.actions, *parameters])
    expected = NODE if guess else f"{NODE} ({listing(vocabulary.actions)})"
    return unknown(word, kind, (), expected=expected, guess=guess)
