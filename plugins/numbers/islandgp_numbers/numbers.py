"""The numbers in a tree file with their purposes, and the file with other numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

from islandgp.bt.core.arithmetic import Written
from islandgp.bt.core.condition import numbers_of as numbers_in_term
from islandgp.bt.core.condition import terms
from islandgp.bt.core.language import parse_placed
from islandgp.bt.core.node import (
    ActionArgs,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    SecondsArgs,
    walk,
)
from islandgp.bt.core.printer import number_text
from islandgp.bt.core.source import Word, plain
from islandgp.bt.core.vocabulary import Vocabulary

SECONDS: Final = "seconds"
"""The purpose of a number of seconds of a wait, a timeout or a cooldown."""

COUNT: Final = "count"
"""The purpose of a count. A number in a comparison has the compared key as its purpose."""

EQUAL: Final = "=="
"""The purpose of a number in a comparison by `==` or `!=`, besides that of the key."""

WEIGHT: Final = "*"
"""The purpose of a number in a sum, and of one that is compared with a sum."""

Purposes: TypeAlias = frozenset[str]

_LABEL: Final = re.compile(r"([\w.]*)[ \t]*([^\w\s]*)\s*$")
"""The word before a number, and the sign between them."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number in a file."""

    label: str  # what is written before it: `charge <`, `repeater`, `low =`
    value: float
    purposes: Purposes  # COUNT, EQUAL, keys; several for a constant or a parameter
    line: int  # from 1
    start: int  # offset in `plain(text)`
    end: int


def numbers_of(
    text: str, vocabulary: Vocabulary, *, name: str = "<tree>", folder: Path | None = None
) -> list[Number]:
    """The numbers that a tree uses, in the order of its file, without those of included files.

    `name` and `folder` are those of `parse`. Raises TreeError as `parse` does.
    """
    tree = parse_placed(text, vocabulary, name=name, folder=folder).node
    words: dict[int, Word] = {}
    purposes: dict[int, Purposes] = {}
    for node in walk(tree):
        for value, purpose in _uses(node):
            word = value.word if isinstance(value, Written) else None
            if word is not None and word.source.name == name:  # None: the number of a word
                at = word.token.start_pos or 0
                words[at] = word
                purposes[at] = purposes.get(at, frozenset()) | purpose
    text = plain(text)
    return [
        Number(_label(text[:at]), float(token), purposes[at], token.line or 1, at, at + len(token))
        for at, token in sorted((at, word.token) for at, word in words.items())
    ]


def _label(before: str) -> str:
    return " ".join(_LABEL.search(before).groups()).strip()  # type: ignore[union-attr]


def _uses(node: Node) -> Iterator[tuple[object, Purposes]]:
    """The numbers of a node, but for those that it assigns: a tree may rely on them elsewhere."""
    match node.args:
        case GuardArgs(condition):
            for term in terms(condition):
                equal = {EQUAL} if term.operator in ("==", "!=") else set()
                purpose = frozenset({term.key, *equal} if term.single else {WEIGHT})
                yield from ((number, purpose) for number in numbers_in_term(term))
        case CountArgs(count):
            yield count, frozenset({COUNT})
        case SecondsArgs(seconds):
            yield seconds, frozenset({SECONDS})
        case ParallelArgs(success, failure):
            yield from ((policy, frozenset({COUNT})) for policy in (success, failure))
        case ActionArgs(name, values):
            for key, value in values:
                yield value, frozenset({argument_purpose(name, key)})


def with_numbers(text: str, numbers: Sequence[Number], values: Sequence[float]) -> str:
    """The text with each of these numbers replaced by a value, and otherwise unchanged."""
    text = plain(text)
    parts: list[str] = []
    end = 0
    for number, value in zip(numbers, values, strict=True):
        parts += [text[end : number.start], number_text(value)]
        end = number.end
    return "".join([*parts, text[end:]])


def argument_purpose(action: str, argument: str) -> str:
    """The purpose of a number that is an argument of an action."""
    return f"{action}.{argument}"
