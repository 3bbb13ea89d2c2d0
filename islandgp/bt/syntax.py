"""A tree file as it is written: places, comments, blank lines and named subtrees.

`language.parse` gives the tree that a file means, with every `use` expanded;
this module gives what stands in the file. It reads the same words in the same
order, and only files that `parse` accepts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from islandgp.bt.comments import Comment, Word, above, commented
from islandgp.bt.condition import OPERATORS, Asked, Compound, Condition, denied, joined
from islandgp.bt.language import built, files_of
from islandgp.bt.node import ABORTS, KINDS, Argument, Node
from islandgp.bt.printer import Named, number_text
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
    parameters: tuple[str, ...]
    body: Written
    line: int  # of the name
    column: int


@dataclass(frozen=True, slots=True)
class Line:
    """`domain NAME`, `include "FILE"` or `constant NAME = NUMBER`."""

    text: str
    before: tuple[Comment, ...]  # own lines above it
    blank_before: bool  # between those and it
    behind: str  # comment behind its last word


@dataclass(frozen=True, slots=True)
class File:
    """A whole file."""

    head: tuple[Line, ...]  # the domain and the files that it includes
    definitions: tuple[Definition | Line, ...]  # subtrees and constants
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
    parts = files_of(text, vocabulary, name=name, folder=folder, start=start)
    built(parts, vocabulary)
    included: dict[str, Definition] = {}
    constants: dict[str, float] = {}
    for source, _ in parts[:-1]:
        of_file = _Reader(source.text, constants, included).file()
        included |= {d.name: d for d in of_file.definitions if isinstance(d, Definition)}
    return _Reader(parts[-1].source.text, constants, included).file()


def expanded(file: File) -> Iterator[Written]:
    """As written, each node of the tree that the file means, in document order.

    A node of a named subtree comes as often as the subtree is used, with the numbers of that use;
    one of an included subtree stands where it is used.
    """
    own = {d.name: d for d in file.definitions if isinstance(d, Definition)}

    def visit(
        written: Written, values: Mapping[str, float], place: Written | None
    ) -> Iterator[Written]:
        while written.node.kind == "use":
            name, *given = written.node.args
            definition = own.get(str(name)) or file.included[str(name)]
            if definition.name not in own:
                place = place or written
            numbers = [_bound(value, values) for value in given]
            values = dict(zip(definition.parameters, map(_as_number, numbers), strict=True))
            written = definition.body
        node = written.node
        if values:
            node = node._replace(args=tuple(_bound(each, values) for each in node.args))
        at = place or written
        yield replace(written, node=node, line=at.line, column=at.column)
        for child in written.children:
            yield from visit(child, values, place)

    if file.root is not None:
        yield from visit(file.root, {}, None)


def _bound(value: Argument, values: Mapping[str, float]) -> Argument:
    """An argument of a node with the values of parameters."""
    if isinstance(value, Named):
        return Named(value.name, values.get(value.name, value))
    if isinstance(value, Condition):
        return value._replace(number=_as_number(_bound(value.number, values)))
    if isinstance(value, Compound):
        parts = tuple(_bound(part, values) for part in value.parts)
        return Compound(value.word, tuple(p for p in parts if isinstance(p, Condition | Compound)))
    return value


def _as_number(value: Argument) -> float:
    assert isinstance(value, int | float)
    return value


class _Reader:
    """Reads words one after the other. The text is known to be right."""

    def __init__(
        self, text: str, constants: dict[str, float], included: Mapping[str, Definition]
    ) -> None:
        """`constants` are those of included files; the file's own are added."""
        self._words = list(commented(text))
        self._next = 0
        self._constants = constants
        self._included = included
        self._parameters: tuple[str, ...] = ()

    def file(self) -> File:
        head: list[Line] = []
        while self._peek() in ("domain", "include"):
            head.append(self._line(2))
        definitions: list[Definition | Line] = []
        while (word := self._peek()) in ("subtree", "constant"):
            definitions.append(self._definition() if word == "subtree" else self._constant())
        root = self._node(()) if self._peek() else None
        at_end = self._words[-1].before
        return File(tuple(head), tuple(definitions), root, at_end, self._included)

    def _peek(self) -> str:
        return str(self._words[self._next].token)

    def _take(self) -> Word:
        word = self._words[self._next]
        self._next += 1
        return word

    def _line(self, count: int) -> Line:
        words = [self._take() for _ in range(count)]
        text = " ".join(str(word.token) for word in words)
        return Line(text, *above(words), words[-1].behind)

    def _constant(self) -> Line:
        name, value = (str(self._words[self._next + at].token) for at in (1, 3))
        number = self._number(value)
        self._constants[name] = float(number)
        line = self._line(4)
        return replace(line, text=f"constant {name} = {number_text(number)}")

    def _definition(self) -> Definition:
        first, name = self._take(), self._take()
        lead = [first, name]
        lead += self._up_to("=")
        lead.append(self._take())
        self._parameters = tuple(str(word.token) for word in lead[3:-2:2])
        body = self._node(tuple(lead))
        found = Definition(str(name.token), self._parameters, body, *_place(name.token))
        self._parameters = ()
        return found

    def _node(self, lead: tuple[Word, ...]) -> Written:
        """A node; comments in `lead` and among the words of its head are put above it."""
        head = [self._take()]
        kind, first = str(head[0].token), head[0].token
        if kind == "use":
            head.append(self._take())
            if self._peek() == "(":
                head += [*self._up_to(")"), self._take()]
        elif kind in _INNER:
            head += self._up_to("{")
        node = self._node_of(head)
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

    def _up_to(self, end: str) -> Iterator[Word]:
        while self._peek() != end:
            yield self._take()

    def _number(self, word: str) -> float:
        """A number; of a constant or a parameter one that remembers its name."""
        if word in self._parameters:
            return Named(word, 1.0)
        if word in self._constants:
            return Named(word, self._constants[word])
        return float(word) + 0.0

    def _node_of(self, head: list[Word]) -> Node:
        """Kind and arguments of a head."""
        kind, *rest = (str(word.token) for word in head)
        if kind == "use":
            return Node("use", (rest[0], *map(self._number, rest[2:-1:2])))
        if kind == "repeater":
            return Node(kind, (self._number(rest[0]),))
        if kind == "parallel":
            found = dict(zip(rest[::2], rest[1::2], strict=True))
            return Node(kind, (found.get("success", "all"), found.get("failure", "one")))
        if kind == "when":
            abort = ABORTS[-1]
            if "abort" in rest:
                *rest, _, abort = rest
            return Node(kind, (self._joined_by("or", rest[::-1]), abort))
        return Node(kind) if kind in KINDS else Node("action", (kind,))

    def _joined_by(self, word: str, rest: list[str]) -> Asked:
        """A condition from the words of `rest`, which it takes from the end of that list."""
        parts: list[Asked] = []
        while not parts or (rest and rest[-1] == word and rest.pop()):
            parts.append(self._joined_by("and", rest) if word == "or" else self._term(rest))
        return joined(word, parts)

    def _term(self, rest: list[str]) -> Asked:
        word = rest.pop()
        if word == "not":
            return denied(self._term(rest))
        if word == "(":
            inside = self._joined_by("or", rest)
            rest.pop()
            return inside
        if rest and rest[-1] in OPERATORS:
            return Condition(word, rest.pop(), self._number(rest.pop()))
        return Condition(word, "is", 0.0)


def _place(token: Token) -> tuple[int, int]:
    return token.line or 1, token.column or 1
