"""Errors of names in trees: what was found, what is known there, and a likely correction."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from textwrap import shorten
from typing import Final

from islandgp.bt.core.kinds import KEYWORDS, SHORT
from islandgp.bt.core.parameters import Parameter, value_range
from islandgp.bt.core.source import Word, closest, shown
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import TreeError, UnknownNameError

NODE_WORDS: Final = (*KEYWORDS, *SHORT, "use")

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


def unknown_key(word: Word, vocabulary: Vocabulary, parameters: Collection[str]) -> TreeError:
    """The error for an unknown key; `parameters` of its subtree are known, too."""
    guess = f"sequence {{ {word.text} ... }}" if word.text in vocabulary.actions else ""
    names = [*vocabulary.keys, *parameters]
    return _unknown(word, "blackboard key", f"a key: {', '.join(vocabulary.keys)}", names, guess)


def unwritable(word: Word, keys: Mapping[str, Key]) -> TreeError:
    """The error for a `set` of a key that trees do not write."""
    writable = [name for name, key in keys.items() if key.writable]
    return word.error(
        f"{shown(word.token)} is no key that trees write",
        f"a key that is declared with `initial`: {', '.join(writable) or 'none'}",
        guess=closest(word.text, writable),
        kind=TreeError if word.text in keys else UnknownNameError,
    )


def wrong_operand(
    name: str, word: Word, keys: Mapping[str, Key], constants: Collection[str]
) -> TreeError:
    """The error for what a key of this name cannot be compared with, or set to."""
    key = keys[name]
    others = [each for each, other in keys.items() if other.kind == key.kind and each != name]
    expected = " | ".join(key.choices) or f"a number, a constant ({_listing(constants)})"
    return word.error(
        f"{shown(word.token)} does not fit {name}, which is {key.kind}",
        expected + f", or another key: {', '.join(others)}" * bool(others),
        guess=closest(word.text, [*key.choices, *constants, *others]),
        kind=TreeError if word.text in keys else UnknownNameError,
    )


def unknown_constant(
    word: Word, constants: Collection[str], keys: Collection[str] = ()
) -> TreeError:
    """The error for an unknown name where a number, or one of `keys`, is expected."""
    names = [*word.values, *constants]
    expected = f"a number or a constant that is defined above ({_listing(names)})"
    expected += f", or a key: {_listing(keys)}" * bool(keys)
    return _unknown(word, "constant", expected, [*names, *keys])


def unknown_argument(word: Word, action: str, parameters: Mapping[str, Parameter]) -> TreeError:
    """The error for an argument that an action does not have."""
    if not parameters:
        return word.error(f"the action {action} takes no arguments", f"`{action}` alone")
    ranges = "; ".join(f"{name}: {value_range(each)}" for name, each in parameters.items())
    guesses = [f"{name}: {word.text}" for name, p in parameters.items() if word.text in p.words]
    return _unknown(word, "argument", ranges, parameters, *guesses[:1], of=f" of {action}")


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
    guess = guess or closest(name, [*NODE_WORDS, *vocabulary.actions, *parameters])
    expected = NODE if guess else node_words(vocabulary)
    return _unknown(word, kind, expected, (), guess)


def node_words(vocabulary: Vocabulary) -> str:
    """The nodes and actions of a domain, as a text."""
    actions = f" ({', '.join(vocabulary.actions)})" if vocabulary.actions else ""
    return f"a node ({', '.join(NODE_WORDS)}) or an action{actions}"


def _unknown(
    word: Word, what: str, expected: str, names: Iterable[str], guess: str = "", *, of: str = ""
) -> TreeError:
    guess = guess[:_LONGEST_GUESS] or closest(word.text, names)
    message = f"unknown {what} {shown(word.token)}{of}"
    return word.error(message, expected, guess=guess, kind=UnknownNameError)


def _listing(names: Iterable[str]) -> str:
    return shorten(", ".join(names), 200, placeholder=" ...") or "none so far"
