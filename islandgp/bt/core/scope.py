"""The numbers of a text of trees: digits, constants and parameters of subtrees."""

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
class Scope:
    """The names of numbers that are known at a place of a text."""

    source: Source
    constants: dict[str, float] = field(default_factory=dict)  # that are defined so far
    values: dict[str, float] = field(default_factory=dict)  # of the subtree's parameters
    named: bool = False  # True: the numbers of constants and parameters are `Named`

    def knows(self, name: str) -> bool:
        """True if the name is one of a constant or a parameter."""
        return name in self.values or name in self.constants

    def number(self, token: _Token) -> float:
        """A number, or the value of the constant or parameter of that name."""
        if token.type == "NAME":
            value = self.values.get(token, self.constants.get(token))
            if value is None:
                raise self.unknown_number(token)
            return Named(str(token), value) if self.named else value
        if not _NUMBER.fullmatch(token):
            raise self.source.error_at(
                token,
                f"{shown(token)} is not a plain number",
                expected="digits with an optional decimal point and no unit: 25, 12.5 or -3",
            )
        value = float(token) + 0.0  # turns -0.0 into 0.0
        if abs(value) > MAX_NUMBER:
            raise self.source.error_at(
                token,
                f"{shown(token)} is out of range",
                expected=f"a number from {-MAX_NUMBER} to {MAX_NUMBER}",
            )
        return value

    def seconds(self, kind: str, argument: Argument, token: _Token) -> float:
        """A duration of a node of that kind, in seconds within the argument's range."""
        least, most = argument.range
        seconds = self.number(token)
        if not least <= seconds <= most:
            raise self.source.error_at(
                token,
                f"a {kind} can't last {shown(token)} seconds",
                expected=f"seconds from {least:g} to {most:,}",
            )
        return seconds

    def count_of(self, argument: Argument, token: _Token, message: str) -> float:
        """A whole number within the argument's range; `message` names another one as `{}`."""
        fewest, most = argument.range
        count = 0.0
        if token.type == "NAME":
            count = self.number(token)
        elif token.isdecimal() and len(token) < 10:
            count = int(token)
        if count != int(count) or not fewest <= count <= most:
            raise self.source.error_at(
                token,
                message.format(shown(token)),
                expected=f"a whole number from {fewest} to {most}",
            )
        return count if isinstance(count, Named) else int(count)

    def unknown_number(self, name: _Token, keys: Sequence[str] = ()) -> TreeError:
        """The error of an unknown name; `keys`: the keys that could be in its place."""
        names = {**self.values, **self.constants}
        known = shorten(", ".join(names), 200, placeholder=" ...")
        others = f"; or a key: {', '.join(keys)}" if keys else ""
        return self.source.error_at(
            name,
            f"unknown constant {'or key ' * bool(keys)}{shown(name)}",
            expected=f"a number, or a constant that is defined above: {known or 'none so far'}"
            f"{others}",
            guess=closest(name, [*names, *keys]),
            kind=UnknownNameError,
        )
