"""Builds a tree from parse trees in one pass: definitions, uses, and the places of nodes.

    subtree fetch(key, least, go) = when key > least { sequence { go Grasp } }
    use fetch(charge, 20, MoveTo(goal: bin))

A subtree is built where it is defined, with parameters that fit everywhere, to find its errors.
A `use` with arguments builds it again, with each argument in place of its parameter. An argument
keeps the meaning of the place where it is written.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from islandgp.bt.core.includes import ParsedFile
from islandgp.bt.core.kinds import KINDS, NODES
from islandgp.bt.core.node import (
    Comments,
    MarkedNode,
    Node,
    NodeMark,
    WrittenArgs,
    as_subtree,
    leaf,
    marked,
    sequence,
    switch,
)
from islandgp.bt.core.node_builder import KEY, NODE, NodeBuilder, Token, Tree
from islandgp.bt.core.printer import head, number_text, use_text
from islandgp.bt.core.source import Source, Word, shown
from islandgp.bt.core.unknown import listing, unknown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import LimitError, TreeError

MAX_LEVELS: Final = 100  # of a tree, a `use` counted expanded
MAX_NODES: Final = 10_000  # of a tree, a `use` counted expanded
MAX_STEPS: Final = 50_000  # nodes and uses that are built for all definitions and uses of a text
_MAX_OPEN: Final = 2 * MAX_LEVELS  # uses and arguments in each other

NO_TREE: Final = sequence()
"""Result for a file that only has definitions: a sequence without children."""


@dataclass(frozen=True, slots=True)
class Template:
    """The definition of a subtree."""

    parameters: Sequence[str]
    defaults: Mapping[str, Word]  # of the last ones
    body: Tree
    source: Source
    node: Node  # without parameters: the subtree, else with open ones
    size: tuple[int, int]  # nodes and levels of it, expanded


class Builder(NodeBuilder):
    """Builds the tree of one text.

    Sizes are counted while building, so that subtrees that double each other are rejected early.
    """

    def __init__(
        self,
        vocabulary: Vocabulary | None,
        *,
        marks: bool = False,
        named: bool = False,
        written: bool = False,
        errors: list[TreeError] | None = None,
    ) -> None:
        """Builds trees of one text.

        Args:
            vocabulary: the valid actions and keys. None: all names are valid.
            marks: mark nodes with places, comments and names of subtrees (`MarkedNode`).
            named: as for `NodeBuilder`.
            written: keep each `use` as a node, with WrittenArgs.
            errors: list to append errors of names and numbers to. None: raise the first one.
        """
        super().__init__(vocabulary, named=named)
        self.bodies: list[Node] = []  # of the last file's subtrees
        self._errors, self._marks, self.written = errors, marks, written
        self._comments: dict[tuple[str, int], Comments] = {}  # by the name and place in a text
        self.nodes = self.levels = 0  # of the tree that is being built, so far
        self._steps = self._open = 0

    def build(self, parts: Sequence[ParsedFile]) -> Node:
        """The root of the last part's tree. Raises TreeError for any error in the text."""
        node = NO_TREE
        for part in parts:
            self.source, trees = part.source, part.tree.children
            self.bodies, node = [], NO_TREE
            if self._marks:
                from islandgp.bt.core.comments import comments_in  # only for trees in files

                found = comments_in(part.source.text, part.tree, blank_lines=self.written)
                self._comments |= {(part.source.name, at): each for at, each in found.items()}
            for tree in trees:
                if tree.data in ("constant", "subtree"):
                    self._define(str(tree.data), *tree.children)
                elif tree.data not in ("domain", "include"):
                    node = self._whole(tree)
        return node

    def _define(self, kind: str, name: Token, *parts: Any) -> None:
        self._check_new(kind, name, self.constants if kind == "constant" else self.subtrees)
        if kind == "constant":
            self.number(parts[0])  # raises its errors
            word = Word(parts[0], self.source)
            self.constants[str(name)] = self.constants.get(word.text, word)
            return
        *before, body = parts
        pairs = [each.children for each in before[0].children] if before else []
        tokens = [token for token, *_ in pairs]
        defaults = {
            str(token): self.passed(default[0], f"{token} of {name}")
            for token, *default in pairs
            if default
        }
        for at, parameter in enumerate(tokens):
            self._check_new("parameter", parameter, tokens[:at])
        self.values = {str(token): Word(token, self.source, open=True) for token in tokens}
        node = self._whole(body)
        self.bodies.append(node)
        size, values = (self.nodes, self.levels), self.values
        template = Template([*values], defaults, body, self.source, node, size)
        self.subtrees[str(name)] = template
        self.values = {}

    def _check_new(self, kind: str, name: Token, known: Collection[str]) -> None:
        """Raises TreeError for a name that is already defined."""
        if name in known:
            raise self.source.error(name, f"{kind} {shown(name)} is defined twice", "a new name")

    def _whole(self, tree: Tree) -> Node:
        self.nodes = self.levels = 0
        return self.node(tree, 1)

    def node(self, tree: Tree, level: int) -> Node:
        """A node with its children, on a level of the whole tree."""
        kind, parts = str(tree.data), tree.children
        try:
            if kind == "use":
                return self._use(tree, level)
            if kind not in KINDS:
                node = self._short_form(tree, level)
                return node if isinstance(node, MarkedNode) else self.marked(node, tree)
            if kind == "action" and parts[0] in self.values:
                return self._placed(tree, level)
            self.count(parts[0], level)
            node, subtrees = self.head(tree)
        except TreeError as error:
            if self._errors is None or isinstance(error, LimitError):
                raise
            self._errors.append(error)
            node, subtrees = NO_TREE, [p for p in parts if getattr(p, "data", "") in NODES]
        node = node._replace(children=tuple([self.node(part, level + 1) for part in subtrees]))
        return self.marked(node, tree)

    def _short_form(self, tree: Tree, level: int) -> Node:
        """The nodes for which a `for`, a `switch` or a case is short, or the form as written."""
        match str(tree.data), tree.children:
            case "for", [_, name, *arguments, body]:
                self.count(name, level)
                words = [Word(name, self.source, open=True)]
                head = f"for {name} in [{', '.join(map(self.argument_text, arguments))}]"
                if not self.written:
                    words = [self.passed(each, f"{name} of the `for`") for each in arguments]
                values = [{**self.values, str(name): word} for word in words]
                nodes = [self.inside(body, self.source, v, level + 1, name) for v in values]
                node = sequence(*nodes)
            case "switch", [_, name, *cases]:
                self.count(name, level)
                key, head = self.word(name, KEY), f"switch {name}"
                values_of_key = [case.children[0] for case in cases if case.data == "case"]
                tests = [self.compare(key, "==", value) for value in values_of_key]
                nodes = [self.node(case, level + 1) for case in cases]
                node = switch(tests, nodes)
            case _, [value, body]:
                self.count(value, level)
                head, nodes = str(value), [self.node(body, level + 1)]
                node = nodes[0]
        return Node(str(tree.data), WrittenArgs(head), tuple(nodes)) if self.written else node

    def marked(self, node: Node, tree: Tree) -> Node:
        """The node with the mark of its place, if nodes are marked."""
        return marked(node, self._mark(tree)) if self._marks else node

    def _placed(self, tree: Tree, level: int) -> Node:
        """The action or subtree that is passed for a parameter, at the parameter's place."""
        name, *values = tree.children
        if values:
            raise self.source.error(
                name, f"parameter {shown(name)} takes no arguments", f"`{name}` alone"
            )
        word = self.word(name, NODE)
        if word.type == "NODE":
            node = self.inside(word.part, word.source, word.values, level, name)
        else:
            self.count(name, level)
            node = leaf(word.text) if word.open else self.leaf(word, ())
            if self._marks:
                mark, token = self._mark(tree), word.token
                if not word.open:
                    place = word.source.name, token.line or 1, token.column or 1
                    mark = mark._replace(place=place)
                node = marked(node, mark)
        return node

    def _use(self, tree: Tree, level: int) -> Node:
        name, *given = tree.children
        if name not in self.subtrees:
            actions = self.vocabulary.actions if self.vocabulary else ()
            guess = f"{name}, without use" if name in (*self.values, *actions) else ""
            expected = f"a subtree that is defined above: {listing(self.subtrees)}"
            word = Word(name, self.source)
            raise unknown(word, "subtree", self.subtrees, expected=expected, guess=guess)
        template: Template = self.subtrees[name]
        parameters, arguments = template.parameters, given[0].children if given else []
        most, least = len(parameters), len(parameters) - len(template.defaults)
        if not least <= len(arguments) <= most:
            raise self.source.error(
                name,
                f"subtree {name} takes {f'{least} to ' * (least < most)}{most}"
                f" argument{'s' * (most != 1)}, found {len(arguments)}",
                f"`use {use_text(name, parameters)}`",
            )
        texts = [self.argument_text(each) for each in arguments] if self._marks else []
        if self.written:
            self.count(name, level)
            head = f"use {use_text(str(name), texts)}"
            return marked(Node("use", WrittenArgs(head)), self._mark(tree))
        if parameters:
            given = {
                parameter: self.passed(argument, f"{parameter} of {name}")
                for parameter, argument in zip(parameters, arguments, strict=False)
            }
            values = {**template.defaults, **given}
            node = self.inside(template.body, template.source, values, level, name)
        else:
            self.count(name, level, *template.size)
            node = template.node
        return as_subtree(node, use_text(name, texts), self._mark(tree)) if self._marks else node

    def passed(self, argument: Any, parameter: str) -> Word:
        """The argument that is passed for a parameter; `parameter`: as messages call it."""
        word = self.values.get(argument) if getattr(argument, "type", "") == "NAME" else None
        return word or Word(argument, self.source, parameter, values=self.values)

    def inside(
        self, tree: Tree, source: Source, values: Mapping[str, Word], level: int, name: Token
    ) -> Node:
        """Build a tree that is written in another place, for the word `name`."""
        outside = self.source, self.values
        self._open += 1
        if self._open > _MAX_OPEN:
            raise self._too_large(name, "the subtrees are used too deeply in each other")
        self.source, self.values = source, values
        node = self.node(tree, level)
        self.source, self.values = outside
        self._open -= 1
        return node

    def parameter_text(self, parameter: Tree) -> str:
        """A parameter with its default as it is written."""
        name, *default = parameter.children
        return " = ".join([str(name), *map(self.argument_text, default)])

    def argument_text(self, argument: Any) -> str:
        """An argument as it is written, or in the name of a subtree."""
        if hasattr(argument, "data"):
            name, *passed = argument.children
            if argument.data == "action":
                return head(self.head(argument)[0])
            inner = passed[0].children if passed and self.written else ()
            return f"use {use_text(str(name), [self.argument_text(each) for each in inner])}"
        if argument.type == "NAME" and argument in self.values:
            word = self.values[argument]
            return f"use {word.text}" if getattr(word.part, "data", "") == "use" else word.text
        if argument.type == "NUMBER" or argument in self.constants:
            return number_text(self.number(argument))
        return str(argument) if self.written else str(argument).strip('"')

    def count(self, token: Token, level: int, nodes: int = 1, levels: int = 1) -> None:
        self._steps += 1
        self.nodes += nodes
        self.levels = max(self.levels, level + levels - 1)
        if self.levels > MAX_LEVELS:
            raise self._too_large(token, "the tree is too deep")
        if self.nodes > MAX_NODES or self._steps > MAX_STEPS:
            raise self._too_large(token, "the tree is too large")

    def _too_large(self, token: Token, message: str) -> TreeError:
        expected = f"at most {MAX_LEVELS} levels and {MAX_NODES} nodes, each use expanded"
        return self.source.error(token, message, expected, kind=LimitError)

    def comments_at(self, tree: Tree | None) -> Comments:
        """The comments of a node or a statement; None: those at the end of the text."""
        start = tree.meta.start_pos if tree else len(self.source.text)
        return self._comments.get((self.source.name, start), Comments())

    def _mark(self, tree: Tree) -> NodeMark:
        place = self.source.name, tree.meta.line, tree.meta.column
        return NodeMark("", place, self.comments_at(tree))
