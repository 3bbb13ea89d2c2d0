"""The words of a tree file that may be wrong anywhere."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

_WORD: Final = re.compile(r'#[^\n]*|"[^"\n]*"?|[A-Za-z_]\w*|-?\.?[0-9][0-9A-Za-z_.]*|[<>=!]=?|\S')


class Word(NamedTuple):
    """A word of a text, comments and names of files included."""

    text: str
    start: int  # offsets into the text
    end: int


def words_of(text: str) -> list[Word]:
    """The words of a text."""
    return [Word(m[0], m.start(), m.end()) for m in _WORD.finditer(text)]


def code_words(text: str) -> list[Word]:
    """The words of a text without its comments."""
    return [word for word in words_of(text) if word.text[0] != "#"]
