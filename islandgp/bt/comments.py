"""The words of a tree file with the comments and blank lines around them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from islandgp.bt.language import words

if TYPE_CHECKING:
    from lark import Token

_BETWEEN = re.compile(r"\n|#[^\n]*")  # what matters between two words


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment on a line of its own."""

    text: str  # with its #
    blank_before: bool  # a blank line stands before it


@dataclass(frozen=True, slots=True)
class Word:
    """A word with what stands around it."""

    token: Token
    before: tuple[Comment, ...]
    blank_before: bool
    behind: str


def commented(text: str) -> Iterator[Word]:
    """The words of a text that `parse` accepts; last an empty word for the end of the text."""
    from lark import Token

    tokens = [*words(text), Token("END", "", start_pos=len(text))]
    end = 0
    held: tuple[Token, tuple[Comment, ...], bool] | None = None
    for token in tokens:
        start = token.start_pos or 0
        behind, before, blank = _comments(text[end:start], first=held is None)
        if held is not None:
            yield Word(*held, behind)
        held = (token, before, blank)
        end = start + len(token)
    if held is not None:
        yield Word(*held, "")


def above(head: list[Word]) -> tuple[tuple[Comment, ...], bool]:
    """All comments before the last word of a head ends, and whether a blank line precedes it."""
    loose: list[str] = []
    for before, word in pairwise(head):
        loose += [before.behind] if before.behind else []
        loose += [comment.text for comment in word.before]
    blank = head[0].blank_before
    if not loose:
        return head[0].before, blank
    first, *others = loose
    moved = (Comment(first, blank), *(Comment(text, False) for text in others))
    return (*head[0].before, *moved), False


def _comments(gap: str, *, first: bool) -> tuple[str, tuple[Comment, ...], bool]:
    """Between two words: the comment on the line of the first one, those on own lines, and
    whether a blank line stands before the second word."""
    behind = ""
    own: list[Comment] = []
    ends = 1 if first else 0  # line ends since the last word or comment; a text begins a line
    blank = False
    for match in _BETWEEN.finditer(gap):
        if match[0] == "\n":
            ends += 1
            blank = ends > 1 and not (first and not own)
        elif ends == 0:
            behind = match[0].rstrip()
        else:
            own.append(Comment(match[0].rstrip(), blank))
            ends, blank = 0, False
    return behind, tuple(own), blank
