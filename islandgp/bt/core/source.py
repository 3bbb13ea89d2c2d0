"""The text of a tree, its words, and error messages that show places in it.

    my_tree.bt:3:14: unknown action 'MoveToGarbag'
        sequence { MoveToBloc Grasp }
                   ^
    Expected a node (selector, ...) or an action (MoveToBlock, ...).
    Did you mean MoveToBlock?

`unknown` and `syntax_errors` have the texts of most errors.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from islandgp.errors import TreeError

if TYPE_CHECKING:
    from lark import Token

_EXCERPT: Final = 100  # most columns of a source line in a message
_LONGEST_GUESS: Final = 40  # most characters of a word for which a correction is searched


@dataclass(frozen=True, slots=True)
class Source:
    """A text with its name in messages, e.g. its file name."""

    text: str  # line ends are "\n"
    name: str

    def error(
        self,
        at: Any,
        message: str,
        expected: str = "",
        *,
        guess: str = "",
        kind: type[TreeError] = TreeError,
    ) -> TreeError:
        """The error for a place.

        Args:
            at: a lark.Token or lark.Tree of the text, or a line and a column, both from 1.
            message: what was found.
            expected: what is accepted there.
            guess: a likely correction.
            kind: the class of the error.
        """
        at = first_word(at)
        line, column = at if isinstance(at, tuple) else (at.line or 1, at.column or 1)
        source = _lines(self.text)[line - 1]
        start = max(0, column - 1 - _EXCERPT * 2 // 3)
        excerpt = "".join(c if c.isprintable() else " " for c in source[start : start + _EXCERPT])
        parts = [
            f"{self.name}:{line}:{column}: {message}",
            f"    {excerpt}".rstrip(),
            f"    {' ' * (column - 1 - start)}^",
        ]
        if expected:
            parts.append(f"Expected {expected}.")
        if guess:
            parts.append(f"Did you mean {guess}?")
        error = kind("\n".join(parts), line=line, column=column, source=source)
        error.guess = guess
        return error


@dataclass(frozen=True, slots=True)
class Word:
    """A word in its place; in place of a parameter, the argument that is passed for it."""

    part: Any  # lark.Token; of an argument that is an action or a `use`, the lark.Tree
    source: Source
    parameter: str = ""  # that it is passed for: `level of recharge`; "": it is no argument
    open: bool = False  # a parameter of the subtree that is being defined; any argument fits
    values: Mapping[str, Word] = field(default_factory=dict)  # parameters where it is written

    @property
    def token(self) -> Token:
        """The word; of a tree its first name."""
        token: Token = first_word(self.part)
        return token

    @property
    def type(self) -> str:
        """NAME, NUMBER, FILE or, of an argument that is a tree, NODE."""
        return str(getattr(self.part, "type", "NODE"))

    @property
    def text(self) -> str:
        """The word as it is written, a text without its quotes."""
        return str(self.token).strip('"')

    def error(self, message: str, expected: str, **about: Any) -> TreeError:
        """The error for the word; that of an argument names the parameter."""
        if self.parameter:
            message = f"{message} (parameter {self.parameter})"
        return self.source.error(self.part, message, expected, **about)


def first_word(part: Any) -> Any:
    """The first word of a lark.Tree; anything else unchanged."""
    while hasattr(part, "children"):
        part = part.children[0]
    return part


@lru_cache(maxsize=1)  # a file may have thousands of warnings
def plain(text: str) -> str:
    """The text with line ends "\\n" and without a byte order mark: in which places are counted."""
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


@lru_cache(maxsize=1)
def _lines(text: str) -> list[str]:
    return text.split("\n")


def closest(word: str, words: Iterable[str]) -> str:
    """The closest word; "" if none is close."""
    if len(word) > _LONGEST_GUESS:
        return ""
    by_lower_case = {each.lower(): each for each in words}
    near = difflib.get_close_matches(word.lower(), by_lower_case, n=1, cutoff=0.6)
    return by_lower_case[near[0]] if near else ""


def shown(word: str) -> str:
    """A word in quotes, shortened if it is very long."""
    return repr(str(word) if len(word) <= _LONGEST_GUESS else word[:_LONGEST_GUESS] + "...")
