"""Resolves the words of a tree's text: numbers, constants and parameters of subtrees."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from textwrap import shorten
from typing import Any, Final, TypeAlias

from islandgp.bt.core.kinds import Argument
from islandgp.bt.core.printer import Named
from islandgp.bt.core.source import Source, closest, shown
from islandgp.errors import TreeError, UnknownNameError

MAX_NUMBER: Final = 1_000_000  # largest magnitude of a threshold

_Token: TypeAlias = Any  # lark.Token

_NUMBER: Final = re.compile(r"-?[0-9]+(\.[0-9]+)?")


@dataclass(frozen=True, slots=True)
class ScopedWord:
    """A word with its meaning in its place; in place of a parameter, the argument passed for it."""

    token: _Token  # an argument has the place of its `use`
    source: Source
    number: float | None = None  # of a constant, or of an argument that is a number
    parameter: str = ""  # that it is passed for: `level of recharge`; "": it is no argument
    open: bool = False  # a parameter of the subtree that is being defined; any argument fits
    part: Any = None  # of an action or a subtree that is passed: the BuiltSubtree

    @property
    def text(self) -> str:
        """The word as it is written, a text without its quotes."""
        return str(self.token).strip('"')

    def error(
        self,
        message: str,
        *,
        expected: str = "",
        guess: str = "",
        kind: type[TreeError] = TreeError,
    ) -> TreeError:
        """The error for the word; that of an argument names the parameter."""
        if self.parameter:
            message = f"{message} (parameter {self.parameter})"
        return self.source.error_at(self.token, message, expected=expected, guess=guess, kind=kind)


@dataclass(frozen=True, slots=True)
class Scope:
    """The names that are defined at a place of a text."""

    source: Source
    constants: dict[str, float] = field(default_factory=dict)  # that are defined so far
    values: dict[str, ScopedWord] = field(default_factory=dict)  # of the subtree's parameters
    named: bool = False  # True: the numbers of constants and parameters are `Named`

    def word(self, token: _Token) -> ScopedWord:
        """The word of a token."""
        if token.type != "NAME":
            return ScopedWord(token, self.source)
        if token in self.values:
            return self.values[token]
        return ScopedWord(token, self.source, self.constants.get(token))

    def has_name(self, name: str) -> bool:
        """True if a constant or a parameter has this name."""
        return name in self.values or name in self.constants

    def number(self, token: _Token) -> float:
        """A number, or the value of the constant or parameter of that name."""
        word = self.word(token)
        value = word.number
        if value is None:
            value = self._written_number(word)
        return Named(str(token), value) if self.named and token.type == "NAME" else value

    def _written_number(self, word: ScopedWord) -> float:
        if word.token.type == "NAME":
            raise self.unknown_number(word)
        if not _NUMBER.fullmatch(word.token):
            raise word.error(
                f"{shown(word.token)} is not a plain number",
                expected="digits with an optional decimal point and no unit: 25, 12.5 or -3",
            )
        value = float(word.token) + 0.0  # turns -0.0 into 0.0
        if abs(value) > MAX_NUMBER:
            raise word.error(
                f"{shown(word.token)} is out of range",
                expected=f"a number from {-MAX_NUMBER} to {MAX_NUMBER}",
            )
        return value

    def seconds(self, kind: str, argument: Argument, token: _Token) -> float:
        """A duration of a node of that kind, in seconds within the argument's range."""
        low, high = argument.range
        seconds = self.number(token)
        if not low <= seconds <= high:
            word = self.word(token)
            raise word.error(
                f"a {kind} can't last {shown(word.token)} seconds",
                expected=f"seconds from {low:g} to {high:,}",
            )
        return seconds

    def count_of(self, argument: Argument, token: _Token, message: str) -> float:
        """A whole number within the argument's range; `message` names another one as `{}`."""
        low, high = argument.range
        count = 0.0
        if token.type == "NAME":
            count = self.number(token)
        elif token.isdecimal() and len(token) < 10:
            count = int(token)
        if count != int(count) or not low <= count <= high:
            word = self.word(token)
            raise word.error(
                message.format(shown(word.token)), expected=f"a whole number from {low} to {high}"
            )
        return count if isinstance(count, Named) else int(count)

    def unknown_number(self, word: ScopedWord, keys: Sequence[str] = ()) -> TreeError:
        """The error of an unknown name; `keys`: the keys that could be in its place."""
        names = self.constants if word.parameter else {**self.values, **self.constants}
        listing = shorten(", ".join(names), 200, placeholder=" ...")
        others = f" or a key ({', '.join(keys)})" if keys else ""
        return word.error(
            f"unknown constant {'or key ' * bool(keys)}{shown(word.token)}",
            expected=f"a number{',' if keys else ' or'} a constant that is defined above"
            f" ({listing or 'none so far'}){others}",
            guess=closest(word.token, [*names, *keys]),
            kind=UnknownNameError,
        )
