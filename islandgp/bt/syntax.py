"""A tree file as it is written: places, comments, blank lines and named subtrees.

`language.parse` gives the tree that a file means, with every `use` expanded;
this module gives what stands in the file. It reads only files that `parse` accepts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from islandgp.bt.builder import Builder
from islandgp.bt.includes import ParsedFile
from islandgp.bt.language import built, files_of, words
from islandgp.bt.node import Node
from islandgp.bt.printer import number_text
from islandgp.bt.vocabulary import Vocabulary

if TYPE_CHECKING:
    from lark import Token

_BETWEEN: Final = re.compile(r"\n|#[^\n]*")  # what matters between two words


@dataclass(frozen=True, slots=True)
class Comment:
    """A comment on a line of its own."""

    text: str  # with its #
    blank_before: bool  # a blank line stands before it


@dataclass(frozen=True, slots=True)
class Written:
    """A node as it is written."""

    node: Node  # kind and arguments, without children; kind "use" with the subtree's name
    children: tuple[Written, ...]
    line: int  # of its first word, from 1
    column: int
    before: tuple[Comment, ...]  # own lines above it
    blank_before: bool  # between those and it
    inside: str  # comment behind its opening brace
    at_end: tuple[Comment, ...]  # own lines before its closing brace
    behind: str  # comment behind its last word


@dataclass(frozen=True, slots=True)
class Definition:
    """`subtree NAME = ...`; the comments and blank lines before it belong to its body."""

    name: str
    parameters: tuple[str, ...]
    body: Written
    line: int  # of the name
    column: int


@dataclass(frozen=True, slots=True)
class Statement:
    """`domain NAME`, `include "FILE"` or `constant NAME = NUMBER`."""

    text: str
    before: tuple[Comment, ...]  # own lines above it
    blank_before: bool  # between those and it
    behind: str  # comment behind its last word


@dataclass(frozen=True, slots=True)
class File:
    """A whole file."""

    head: tuple[Statement, ...]  # the domain and the files that it includes
    definitions: tuple[Definition | Statement, ...]  # subtrees and constants
    root: Written | None  # None: it only holds definitions
    at_end: tuple[Comment, ...]
    included: Mapping[str, Definition]  # subtrees of the files that it includes


def read(
    text: str,
    vocabulary: Vocabulary | None = None,
    *,
    name: str = "<tree>",
    folder: Path | None = None,
    library: bool = False,
) -> File:
    """What stands in a text. Raises TreeError as `parse` does.

    `folder` is that of `parse`. `library`: the text need not hold a tree.
    """
    start = "library" if library else "start"
    parts = files_of(text, vocabulary, name=name, folder=folder, start=start, placed=True)
    builder = Builder(parts[-1].source, vocabulary)
    built(builder, parts)
    included: dict[str, Definition] = {}
    for part in parts[:-1]:
        of_file = _Reader(part, builder).file({})
        included |= {d.name: d for d in of_file.definitions if isinstance(d, Definition)}
    return _Reader(parts[-1], builder).file(included)


class _Word(NamedTuple):
    """A word with what stands around it."""

    token: Token
    before: tuple[Comment, ...]  # own lines above it
    blank_before: bool
    behind: str  # comment on its line, before the next word


class _Reader:
    """Puts the comments and blank lines of one file to what the grammar has found in it."""

    def __init__(self, part: ParsedFile, builder: Builder) -> None:
        """`builder` has built the file."""
        self._tree, self._builder = part.tree, builder
        self._words = list(_words(part.source.text))
        self._first = {word.token.start_pos: i for i, word in enumerate(self._words)}
        self._behind = {word.token.end_pos: i for i, word in enumerate(self._words, 1)}

    def file(self, included: Mapping[str, Definition]) -> File:
        """The file, which uses these subtrees of others."""
        head: list[Statement] = []
        definitions: list[Definition | Statement] = []
        root = None
        for tree in self._tree.children:
            if tree.data in ("domain", "include"):
                head.append(self._line(tree))
            elif tree.data == "constant":
                definitions.append(self._line(tree))
            elif tree.data == "subtree":
                definitions.append(self._definition(tree))
            else:
                root = self._node(tree, ())
        return File(tuple(head), tuple(definitions), root, self._words[-1].before, included)

    def _span(self, tree: Any) -> tuple[int, int]:
        """The index of a tree's first word, and the index behind its last."""
        return self._first[tree.meta.start_pos], self._behind[tree.meta.end_pos]

    def _line(self, tree: Any) -> Statement:
        first, behind = self._span(tree)
        found = self._words[first:behind]
        texts = [str(word.token) for word in found]
        if found[-1].token.type == "NUMBER":
            texts[-1] = number_text(float(texts[-1]) + 0.0)  # no -0
        return Statement(" ".join(texts), *_above(found), found[-1].behind)

    def _definition(self, tree: Any) -> Definition:
        name, *more, body = tree.children
        parameters = tuple(str(token) for each in more for token in each.children)
        lead = self._words[self._span(tree)[0] : self._span(body)[0]]
        written = self._node(body, parameters, lead)
        return Definition(str(name), parameters, written, name.line, name.column)

    def _node(self, tree: Any, parameters: Sequence[str], lead: Sequence[_Word] = ()) -> Written:
        """A node; comments in `lead` and among the words of its head are put above it."""
        first, behind = self._span(tree)
        node, below = self._builder.written(tree, parameters)
        brace = self._span(below[0])[0] - 1 if below else behind - 1
        before = _above([*lead, *self._words[first : brace + 1]])
        last = self._words[behind - 1]
        return Written(
            node,
            tuple(self._node(each, parameters) for each in below),
            tree.meta.line,
            tree.meta.column,
            *before,
            self._words[brace].behind if below else "",
            last.before if below else (),
            last.behind,
        )


def _words(text: str) -> Iterator[_Word]:
    """The words of a text that `parse` accepts; last an empty word for the end of the text."""
    from lark import Token

    tokens = [*words(text), Token("END", "", start_pos=len(text), end_pos=len(text))]
    end = 0
    held: tuple[Token, tuple[Comment, ...], bool] | None = None
    for token in tokens:
        start = token.start_pos or 0
        behind, before, blank = _comments(text[end:start], first=held is None)
        if held is not None:
            yield _Word(*held, behind)
        held = (token, before, blank)
        end = start + len(token)
    if held is not None:
        yield _Word(*held, "")


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


def _above(head: Sequence[_Word]) -> tuple[tuple[Comment, ...], bool]:
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
