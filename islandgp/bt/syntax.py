"""A tree file as it is written: places, comments, blank lines and named subtrees.

`language.parse` gives the tree that a file means, with every `use` expanded;
this module gives what stands in the file. It reads the same words in the same
order, and only files that `parse` accepts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from islandgp.bt.language import parse, plain, words
from islandgp.bt.node import ABORTS, FLAG_OPERATORS, KINDS, OPERATORS, Node

if TYPE_CHECKING:
    from lark import Token

_INNER = frozenset(KINDS) - {"action"}  # kinds with a brace
_BETWEEN = re.compile(r"\n|#[^\n]*")  # what matters between two words


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
    body: Written
    line: int  # of the name
    column: int


@dataclass(frozen=True, slots=True)
class File:
    """A whole file."""

    definitions: tuple[Definition, ...]
    root: Written
    at_end: tuple[Comment, ...]


@dataclass(frozen=True, slots=True)
class _Word:
    token: Token
    before: tuple[Comment, ...]
    blank_before: bool
    behind: str


def read(text: str, *, name: str = "<tree>") -> File:
    """What stands in a text. Raises TreeError as `parse` does."""
    parse(text, name=name)
    return _Reader(plain(text)).file()


def expanded(file: File) -> Iterator[Written]:
    """As written, each node of the tree that the file means, in document order.

    A node of a named subtree comes as often as the subtree is used.
    """
    bodies = {definition.name: definition.body for definition in file.definitions}

    def visit(written: Written) -> Iterator[Written]:
        if written.node.kind == "use":
            yield from visit(bodies[str(written.node.args[0])])
            return
        yield written
        for child in written.children:
            yield from visit(child)

    return visit(file.root)


class _Reader:
    """Reads words one after the other. The text is known to be right."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._words = list(self._with_comments())
        self._next = 0

    def file(self) -> File:
        definitions = []
        while self._peek() == "subtree":
            definitions.append(self._definition())
        root = self._node(())
        return File(tuple(definitions), root, self._words[-1].before)

    def _with_comments(self) -> Iterator[_Word]:
        """Each word with what stands around it; last an empty word for the end of the text."""
        from lark import Token

        tokens = [*words(self._text), Token("END", "", start_pos=len(self._text))]
        end = 0
        held: tuple[Token, tuple[Comment, ...], bool] | None = None
        for token in tokens:
            start = token.start_pos or 0
            behind, before, blank = _comments(self._text[end:start], first=held is None)
            if held is not None:
                yield _Word(*held, behind)
            held = (token, before, blank)
            end = start + len(token)
        if held is not None:
            yield _Word(*held, "")

    def _peek(self) -> str:
        return str(self._words[self._next].token)

    def _take(self) -> _Word:
        word = self._words[self._next]
        self._next += 1
        return word

    def _definition(self) -> Definition:
        first, name, equal = self._take(), self._take(), self._take()
        body = self._node((first, name, equal))
        return Definition(str(name.token), body, *_place(name.token))

    def _node(self, lead: tuple[_Word, ...]) -> Written:
        """A node; comments in `lead` and among the words of its head are put above it."""
        head = [self._take()]
        kind, first = str(head[0].token), head[0].token
        if kind == "use":
            head.append(self._take())
        elif kind in _INNER:
            head += self._up_to_brace()
        node = _node_of(head)
        if kind not in _INNER:
            before = _above([*lead, *head])
            return Written(node, (), *_place(first), *before, "", (), head[-1].behind)
        brace = self._take()
        children = []
        while self._peek() != "}":
            children.append(self._node(()))
        end = self._take()
        before = _above([*lead, *head, brace])
        return Written(
            node, tuple(children), *_place(first), *before, brace.behind, end.before, end.behind
        )

    def _up_to_brace(self) -> Iterator[_Word]:
        while self._peek() != "{":
            yield self._take()


def _place(token: Token) -> tuple[int, int]:
    return token.line or 1, token.column or 1


def _above(head: list[_Word]) -> tuple[tuple[Comment, ...], bool]:
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


def _node_of(head: list[_Word]) -> Node:
    """Kind and arguments of a head."""
    kind, *rest = (str(word.token) for word in head)
    if kind == "use":
        return Node("use", (rest[0],))
    if kind == "repeater":
        return Node(kind, (int(rest[0]),))
    if kind == "parallel":
        found = dict(zip(rest[::2], rest[1::2], strict=True))
        return Node(kind, (found.get("success", "all"), found.get("failure", "one")))
    if kind == "when":
        return Node(kind, _when(rest))
    return Node(kind) if kind in KINDS else Node("action", (kind,))


def _when(rest: list[str]) -> tuple[str | float, ...]:
    abort = ABORTS[-1]
    if "abort" in rest:
        *rest, _, abort = rest
    if rest[0] == "not":
        return (rest[1], FLAG_OPERATORS[1], 0.0, abort)
    if len(rest) == 1:
        return (rest[0], FLAG_OPERATORS[0], 0.0, abort)
    key, operator, number = rest
    assert operator in OPERATORS
    return (key, operator, float(number) + 0.0, abort)
