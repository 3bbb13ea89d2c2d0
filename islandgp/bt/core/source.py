"""The text of a tree, and error messages that show places in it.

    my_tree.bt:3:14: unknown action 'MoveToGarbag'
        sequence { MoveToBloc Grasp }
                   ^
    Expected a node (selector, ...) or an action (MoveToBlock, ...).
    Did you mean MoveToBlock?

`diagnosis`, `unknown_names` and `builder` choose the texts of such messages.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from islandgp.errors import TreeError

if TYPE_CHECKING:
    from lark import Token

_BEFORE_NODE: Final = re.compile(r"\s*(subtree\s+\w+\s*(\([^)]*\))?\s*=\s*)?(use\s+)?")
_QUOTED: Final = re.compile(r'"[^"]*"')
_EXCERPT = 100  # most columns of a source line in a message
_LONGEST_GUESS = 40  # most characters of a word for which a correction is searched


@dataclass(frozen=True, slots=True)
class Source:
    """A text with its name in messages, e.g. its file name."""

    text: str  # line ends are "\n"
    name: str

    def error(
        self,
        message: str,
        line: int,
        column: int,
        *,
        expected: str = "",
        guess: str = "",
        kind: type[TreeError] = TreeError,
    ) -> TreeError:
        """The error for a place; `line` and `column` count from 1."""
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

    def comments_at(self, token: Token) -> tuple[str, ...]:
        """The comments above a node that begins its line, and at the end of that line.

        Args:
            token: the first word of the node, or the name after `use`.

        Returns:
            The lines without `#`; none if another node begins the line.
        """
        lines = _lines(self.text)
        row, column = (token.line or 1) - 1, (token.column or 1) - 1
        if not _BEFORE_NODE.fullmatch(lines[row][:column]):
            return ()
        _, sign, behind = _QUOTED.sub("", lines[row][column:]).partition("#")
        comments = [behind.strip()] if sign else []
        for above in range(row - 1, -1, -1):
            text = lines[above].strip()
            if text and not text.startswith("#"):
                break
            if text:
                comments.insert(0, text.lstrip("#").strip())
        return tuple(filter(None, comments))

    def error_at(
        self,
        token: Token,
        message: str,
        *,
        expected: str = "",
        guess: str = "",
        kind: type[TreeError] = TreeError,
    ) -> TreeError:
        """The error for a word of the text."""
        line, column = token.line or 1, token.column or 1
        return self.error(message, line, column, expected=expected, guess=guess, kind=kind)


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
