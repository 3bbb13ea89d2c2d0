"""Messages for unknown names of keys, words, arguments and nodes, with a likely correction."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

from islandgp.bt.core.kinds import KEYWORDS
from islandgp.bt.core.parameters import Parameter, value_range
from islandgp.bt.core.scope import ScopedWord
from islandgp.bt.core.source import Source, closest, shown
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import TreeError, UnknownNameError

if TYPE_CHECKING:
    from lark import Token

NODE_WORDS = (*KEYWORDS, "use")

FOREIGN_WORDS = {
    "fallback": "selector", "priority": "selector", "reactivefallback": "reactive_selector",
    "if": "when", "while": "when", "guard": "when", "condition": "when", "switch": "when",
    "loop": "repeater", "delay": "wait", "sleep": "wait", "invert": "inverter",
    "retryuntilsuccessful": "retry", "ratecontroller": "every", "pipelinesequence": "pipeline",
    "subtree": "use", "subtreeplus": "use", "const": "constant", "def": "subtree",
    **dict.fromkeys(("else", "elif", "elseif"), "selector { when ... { ... } ... }"),
}  # fmt: skip
"""Keywords of other languages, with the correct form."""


def unknown_key(
    word: ScopedWord, vocabulary: Vocabulary, parameters: Collection[str] = ()
) -> TreeError:
    """The error for a `when` with an unknown key; `parameters` of its subtree are known, too."""
    token = word.token
    return word.error(
        f"unknown blackboard key {shown(token)}",
        expected=f"a key: {', '.join(vocabulary.keys)}",
        guess=f"sequence {{ {token} ... }}"
        if token in vocabulary.actions
        else closest(token, [*vocabulary.keys, *([] if word.parameter else parameters)]),
        kind=UnknownNameError,
    )


def unwritable(word: ScopedWord, vocabulary: Vocabulary) -> TreeError:
    """The error for a `set` of a key that trees do not write."""
    writable = [name for name, key in vocabulary.keys.items() if key.writable]
    known = word.text in vocabulary.keys
    return word.error(
        f"{word.text} is a key that only the domain writes"
        if known
        else f"unknown blackboard key {shown(word.token)}",
        expected=f"a key that is declared with `initial`: {', '.join(writable) or 'none'}",
        guess="" if known else closest(word.token, writable),
        kind=TreeError if known else UnknownNameError,
    )


def unknown_word(word: ScopedWord, name: str, key: Key, keys: Sequence[str]) -> TreeError:
    """The error for an unknown word of a key; `keys` have the same words."""
    others = f", or a key of the same words: {', '.join(keys)}" if keys else ""
    return word.error(
        f"unknown word {shown(word.token)} of {name}",
        expected=f"{key.kind}{others}",
        guess=closest(word.token, [*key.words, *keys]),
        kind=UnknownNameError,
    )


def unknown_argument(
    source: Source, token: Token, action: str, parameters: Mapping[str, Parameter]
) -> TreeError:
    """The error for an argument that an action does not have."""
    if not parameters:
        return source.error_at(
            token, f"the action {action} takes no arguments", expected=f"`{action}` alone"
        )
    ranges = (f"{name}: {value_range(each)}" for name, each in parameters.items())
    return source.error_at(
        token,
        f"unknown argument {shown(token)} of {action}",
        expected="; ".join(ranges),
        guess=next(
            (f"{name}: {token}" for name, each in parameters.items() if token in each.words),
            closest(token, parameters),
        ),
        kind=UnknownNameError,
    )


def unknown_node(
    word: ScopedWord,
    subtrees: Collection[str],
    vocabulary: Vocabulary,
    parameters: Collection[str] = (),
) -> TreeError:
    """The error for a word that is not a node, where a node is expected."""
    token = word.token
    rest = word.source.text[token.end_pos :].lstrip()
    if rest.startswith("="):
        guess = f"constant {token}"
    elif token in subtrees and closest(token, subtrees):
        guess = f"use {token}"
    elif token in vocabulary.keys:
        guess = f"when {vocabulary.keys[token].example(token)} {{ ... }}"
    else:
        guess = FOREIGN_WORDS.get(token.lower()) or closest(
            token, (*NODE_WORDS, *vocabulary.actions, *parameters)
        )
    kind = "node" if rest.startswith("{") else "action"
    return word.error(
        f"unknown {kind} {shown(token)}",
        expected="a node or an action" if guess else node_words(vocabulary),
        guess=guess,
        kind=UnknownNameError,
    )


def node_words(vocabulary: Vocabulary) -> str:
    """The nodes and actions of a domain, as a text."""
    actions = f" ({', '.join(vocabulary.actions)})" if vocabulary.actions else ""
    return f"a node ({', '.join(NODE_WORDS)}) or an action{actions}"
