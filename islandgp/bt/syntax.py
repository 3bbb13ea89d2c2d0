"""A tree file as it is written: places, comments, blank lines and named subtrees.

`language.parse` gives the tree that a file means, with every `use` expanded;
this module gives what stands in the file. It reads the same words in the same
order, and only files that `parse` accepts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from islandgp.bt.comments import Comment, Word, above, commented
from islandgp.bt.condition import OPERATORS, Asked, Condition, denied, joined
from islandgp.bt.language import parse, plain
from islandgp.bt.node import ABORTS, KINDS, Node
from islandgp.bt.vocabulary import Vocabulary

if TYPE_CHECKING:
    from lark import Token

_INNER = frozenset(KINDS) - {"action"}  # kinds with a brace


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
class Domain:
    """`domain NAME`: what the tree is for."""

    name: str
    before: tuple[Comment, ...]  # own lines above it
    blank_before: bool  # between those and it
    behind: str  # comment behind the name


@dataclass(frozen=True, slots=True)
class File:
    """A whole file."""

    domain: Domain | None
    definitions: tuple[Definition, ...]
    root: Written
    at_end: tuple[Comment, ...]


def read(text: str, vocabulary: Vocabulary | None = None, *, name: str = "<tree>") -> File:
    """What stands in a text. Raises TreeError as `parse` does."""
    parse(text, vocabulary, name=name)
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
        self._words = list(commented(text))
        self._next = 0

    def file(self) -> File:
        domain = self._domain() if self._peek() == "domain" else None
        definitions = []
        while self._peek() == "subtree":
            definitions.append(self._definition())
        root = self._node(())
        return File(domain, tuple(definitions), root, self._words[-1].before)

    def _peek(self) -> str:
        return str(self._words[self._next].token)

    def _take(self) -> Word:
        word = self._words[self._next]
        self._next += 1
        return word

    def _domain(self) -> Domain:
        first, name = self._take(), self._take()
        before, blank = above([first, name])
        return Domain(str(name.token), before, blank, name.behind)

    def _definition(self) -> Definition:
        first, name, equal = self._take(), self._take(), self._take()
        body = self._node((first, name, equal))
        return Definition(str(name.token), body, *_place(name.token))

    def _node(self, lead: tuple[Word, ...]) -> Written:
        """A node; comments in `lead` and among the words of its head are put above it."""
        head = [self._take()]
        kind, first = str(head[0].token), head[0].token
        if kind == "use":
            head.append(self._take())
        elif kind in _INNER:
            head += self._up_to_brace()
        node = _node_of(head)
        if kind not in _INNER:
            before = above([*lead, *head])
            return Written(node, (), *_place(first), *before, "", (), head[-1].behind)
        brace = self._take()
        children = []
        while self._peek() != "}":
            children.append(self._node(()))
        end = self._take()
        before = above([*lead, *head, brace])
        return Written(
            node, tuple(children), *_place(first), *before, brace.behind, end.before, end.behind
        )

    def _up_to_brace(self) -> Iterator[Word]:
        while self._peek() != "{":
            yield self._take()


def _place(token: Token) -> tuple[int, int]:
    return token.line or 1, token.column or 1


def _node_of(head: list[Word]) -> Node:
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


def _when(rest: list[str]) -> tuple[Asked, str]:
    abort = ABORTS[-1]
    if "abort" in rest:
        *rest, _, abort = rest
    return _joined_by("or", rest[::-1]), abort


def _joined_by(word: str, rest: list[str]) -> Asked:
    """A condition from the words of `rest`, which it takes from the end of that list."""
    parts: list[Asked] = []
    while not parts or (rest and rest[-1] == word and rest.pop()):
        parts.append(_joined_by("and", rest) if word == "or" else _term(rest))
    return joined(word, parts)


def _term(rest: list[str]) -> Asked:
    word = rest.pop()
    if word == "not":
        return denied(_term(rest))
    if word == "(":
        inside = _joined_by("or", rest)
        rest.pop()
        return inside
    if rest and rest[-1] in OPERATORS:
        return Condition(word, rest.pop(), float(rest.pop()) + 0.0)
    return Condition(word, "is", 0.0)
