"""Builds nodes from parse trees; checks names, numbers and sizes, which the grammar cannot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from textwrap import shorten
from typing import Any, Final, NamedTuple, TypeAlias

from islandgp.bt.core.condition import ConditionExpr
from islandgp.bt.core.condition_builder import built_condition
from islandgp.bt.core.diagnosis import unknown_argument, unknown_node
from islandgp.bt.core.includes import ParsedFile
from islandgp.bt.core.kinds import KINDS, Argument, Sort
from islandgp.bt.core.node import ActionArgs, Node, UseArgs, Value, as_subtree, commented, sequence
from islandgp.bt.core.parameters import fits, value_range
from islandgp.bt.core.printer import use_text
from islandgp.bt.core.scope import Scope
from islandgp.bt.core.source import Source, closest, shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import LimitError, TreeError, UnknownNameError

MAX_LEVELS: Final = 100  # of a tree, a `use` counted expanded
MAX_NODES: Final = 10_000  # of a tree, a `use` counted expanded
MAX_INSTANCES: Final = 1_000  # different arguments with which subtrees are used

# lark.Tree and lark.Token: trees mix both, at places determined by the grammar.
_Tree: TypeAlias = Any
_Token: TypeAlias = Any

NO_TREE: Final = sequence()
"""Result for a file that only has definitions: a sequence without children."""

_Places: TypeAlias = list[Any]
"""Places of nodes, in document order: a word, or (a subtree, its use)."""


class NodePlace(NamedTuple):
    """The place of a node in its file."""

    line: int  # from 1
    column: int
    origin: int  # the same for all uses of a node of a subtree


@dataclass(frozen=True, slots=True)
class _BuiltSubtree:
    node: Node
    nodes: int  # expanded
    levels: int  # expanded
    places: _Places
    source: Source


@dataclass(frozen=True, slots=True)
class _Template:
    """The definition of a subtree. With parameters it is built for each set of arguments."""

    parameters: tuple[str, ...]
    body: _Tree
    whole: _BuiltSubtree  # with 1 for each parameter


class Builder:
    """Builds the tree of one text.

    Sizes are counted while building, with a `use` as large as its subtree, so
    that subtrees which double each other are refused before they are expanded.
    """

    def __init__(
        self,
        source: Source,
        vocabulary: Vocabulary | None,
        *,
        marked: bool = False,
        named: bool = False,
        errors: list[TreeError] | None = None,
    ) -> None:
        """Builds trees of one text.

        Args:
            source: the text.
            vocabulary: the valid actions and keys. None: all names are valid.
            marked: mark nodes with their comments and the names of subtrees: `MarkedNode`.
            named: make the numbers of constants and parameters `Named`.
            errors: list to append errors of names and numbers to. None: raise the first one.
        """
        self._errors = errors
        self._marked = marked
        self._scope = Scope(source, named=named)
        self._vocabulary = vocabulary
        self._later: set[str] = set()  # subtrees whose definition is not finished
        self.nodes = 0  # of the tree that is being built, so far
        self.levels = 0
        self._templates: dict[str, _Template] = {}
        self._instances: dict[tuple[str, tuple[float, ...]], _BuiltSubtree] = {}
        self._defining = False  # whether each parameter has the value 1 until the subtree is used
        self._open = 0  # subtrees with parameters that are being built
        self._base = 1  # level of the root of what is being built
        self._name = ""  # of the subtree that is being built
        self._places: _Places = []  # of the tree that is being built

    def build(self, parts: Sequence[ParsedFile]) -> Node:
        """The root of the last part's tree. Raises TreeError for any error in the text."""
        for part in parts:
            self._scope = replace(self._scope, source=part.source)
            definitions = [each for each in part.tree.children if _is(each, "subtree", "constant")]
            self._later = {str(each.children[0]) for each in definitions if _is(each, "subtree")}
            for definition in definitions:
                if definition.data == "constant":
                    self._constant(*definition.children)
                else:
                    self._define(definition.children[0], definition.children[1:])
        last = parts[-1].tree.children[-1:]
        if not last or _is(last[0], "subtree", "constant", "include", "domain"):
            return NO_TREE
        return self._whole(last[0])

    def condition(self, tree: _Tree) -> ConditionExpr:
        """Builds a condition that is not part of a tree."""
        return built_condition(tree, self._scope, self._vocabulary)

    def _constant(self, name: _Token, value: _Token) -> None:
        if name in self._scope.constants:
            raise self._scope.source.error_at(
                name, f"constant {shown(name)} is defined twice", expected="a new name"
            )
        self._scope.constants[str(name)] = self._scope.number(value)

    def _define(self, name: _Token, parts: Sequence[_Tree]) -> None:
        if name in self._templates:
            raise self._scope.source.error_at(
                name, f"subtree {shown(name)} is defined twice", expected="a new name"
            )
        *before, body = parts
        parameters = before[0].children if before else []
        for index, parameter in enumerate(parameters):
            if parameter in parameters[:index]:
                raise self._scope.source.error_at(
                    parameter,
                    f"parameter {shown(parameter)} is defined twice",
                    expected="a new name",
                )
        # Built once with numbers that are valid everywhere, to find errors in the definition.
        outside = self._scope
        self._scope = replace(outside, values=dict.fromkeys(map(str, parameters), 1.0))
        self._defining = True
        whole = self._finished(self._whole(body, name))
        self._defining = False
        self._templates[str(name)] = _Template(tuple(self._scope.values), body, whole)
        self._scope = outside
        self._later.discard(str(name))

    def _instance(self, name: _Token, arguments: Sequence[_Token], level: int) -> _BuiltSubtree:
        """The subtree with these arguments; each is built once."""
        template = self._templates[str(name)]
        if arguments and not template.parameters:
            raise self._scope.source.error_at(
                name, f"subtree {shown(name)} takes no numbers", expected=f"`use {name}`"
            )
        if len(arguments) != len(template.parameters):
            raise self._scope.source.error_at(
                name,
                f"subtree {name} takes {_numbers(template.parameters)}, found {len(arguments)}",
                expected=f"`use {name}({', '.join(template.parameters)})`",
            )
        if not arguments:
            return template.whole
        values = tuple(map(self._scope.number, arguments))
        key = (str(name), values)
        if key in self._instances:
            return self._instances[key]
        if len(self._instances) >= MAX_INSTANCES or self._open >= MAX_LEVELS:
            raise self._scope.source.error_at(
                name,
                "subtrees are used with too many arguments",
                expected=f"at most {MAX_INSTANCES} different ones, {MAX_LEVELS} in each other",
                kind=LimitError,
            )
        kept = self._scope, self._name, self._base
        outside = self.nodes, self.levels, self._places
        kept_defining, self._defining = self._defining, False
        own_values = dict(zip(template.parameters, values, strict=True))
        self._scope = replace(self._scope, source=template.whole.source, values=own_values)
        self._open += 1
        node = self._whole(template.body, str(name), self._base + level - 1)
        self._open -= 1
        subtree = self._instances[key] = self._finished(node)
        self._defining = kept_defining
        self._scope, self._name, self._base = kept
        self.nodes, self.levels, self._places = outside
        return subtree

    def _finished(self, node: Node) -> _BuiltSubtree:
        return _BuiltSubtree(node, self.nodes, self.levels, self._places, self._scope.source)

    def _whole(self, tree: _Tree, name: str = "", base: int = 1) -> Node:
        """A tree whose root is on the level `base` of all that is being built."""
        self.nodes = self.levels = 0
        self._name, self._base, self._places = name, base, []
        return self._node(tree, 1)

    def places(self) -> list[NodePlace]:
        """The place of each node of the built tree, in document order.

        A node of an included subtree has the place of its use. The parse trees must be placed.
        """
        places: list[NodePlace] = []
        inside: list[tuple[Iterator[Any], tuple[int, int] | None]] = [(iter(self._places), None)]
        while inside:
            rest, at = inside[-1]
            for each in rest:
                if isinstance(each, tuple):
                    subtree, use = each
                    own = subtree.source is self._scope.source
                    here = at or (None if own else (use.meta.line, use.meta.column))
                    inside.append((iter(subtree.places), here))
                    break
                line, column = at or (each.line, each.column)
                places.append(NodePlace(line, column, id(each)))
            else:
                inside.pop()
        return places

    def _node(self, tree: _Tree, level: int) -> Node:
        kind, parts = str(tree.data), tree.children
        try:
            if kind == "use":
                return self._use(tree, parts[0], parts[1].children if parts[1:] else [], level)
            self._count(parts[0], nodes=1, deepest=level)
            self._places.append(parts[0])
            node, subtrees = self._head(tree)
        except TreeError as error:
            if self._errors is None or isinstance(error, LimitError):
                raise
            self._errors.append(error)
            node, subtrees = NO_TREE, [part for part in parts if _is(part, *KINDS, "use")]
        node = node._replace(children=tuple([self._node(part, level + 1) for part in subtrees]))
        return commented(node, self._scope.source.comments_at(parts[0])) if self._marked else node

    def _head(self, tree: _Tree) -> tuple[Node, Sequence[_Tree]]:
        """A node without its children, and the trees of these."""
        kind, parts = str(tree.data), tree.children
        if kind == "action":
            arguments = parts[1].children if parts[1:] else []
            return self._leaf(parts[0], [each.children for each in arguments]), ()
        values: list[Any] = []
        rest = list(parts[1:])
        for argument in KINDS[kind].arguments:
            is_given = argument.default is None or _is(rest[0], argument.name)
            values.append(
                self._argument(kind, argument, rest.pop(0)) if is_given else argument.default
            )
        return Node(kind, KINDS[kind].make_args(values)), rest

    def _leaf(self, name: _Token, arguments: Sequence[tuple[_Token, _Token]]) -> Node:
        """A leaf from the names and values of its arguments."""
        words, values = self._vocabulary, dict[str, Value]()
        if words is not None and name not in words.actions:
            raise unknown_node(self._scope.source, name, self._templates, words)
        for key, value in arguments:
            if key in values:
                raise self._scope.source.error_at(
                    key, f"argument {shown(key)} is given twice", expected="each argument once"
                )
            values[str(key)] = self._value(name, key, value)
        if words is None or self._scope.named:
            return Node("action", ActionArgs(str(name), tuple(values.items())))
        return words.leaf(str(name), values)

    def _value(self, action: _Token, key: _Token, token: _Token) -> Value:
        """The value of an argument; without a vocabulary any word is one."""
        words, known = self._vocabulary, self._scope.knows(token)
        written = str(token).strip('"')
        if words is None:
            numeric = token.type == "NUMBER" or (token.type == "NAME" and known)
            return self._scope.number(token) if numeric else written
        parameters = words.actions[action].arguments
        if key not in parameters:
            raise unknown_argument(self._scope.source, key, action, parameters)
        parameter = parameters[key]
        value = self._scope.number(token) if parameter.numeric else written
        if parameter.numeric and self._defining and token in self._scope.values:
            return value  # checked where the subtree is used
        if not fits(parameter, value):
            raise self._scope.source.error_at(
                token,
                f"{shown(token)} is not a value of {key}",
                expected=value_range(parameter),
                guess=closest(token, parameter.words),
            )
        return value

    def _argument(self, kind: str, argument: Argument, tree: _Tree) -> ConditionExpr | float | str:
        """The value of an argument from its parse tree."""
        if argument.sort is Sort.CONDITION:
            return self.condition(tree)
        if argument.sort is Sort.SECONDS:
            return self._scope.seconds(kind, argument, tree)
        if argument.sort is Sort.COUNT:
            return self._scope.count_of(argument, tree, f"a {kind} can't repeat {{}} times")
        word = tree.children[0]
        if word.type == "NAME" and not self._scope.knows(word):
            raise self._scope.source.error_at(
                word,
                f"unexpected {shown(word)}",
                expected=f"one of: {' '.join(sorted(argument.words))}, or a whole number",
                guess=closest(word, argument.words),
                kind=UnknownNameError,
            )
        if word.type in ("NAME", "NUMBER"):
            return self._scope.count_of(
                argument, word, f"{{}} is not a number of children for {argument.name}"
            )
        return str(word)

    def written(self, tree: _Tree, parameters: Sequence[str]) -> Node:
        """A tree of what has been built, as it is written, in a subtree with these parameters.

        The number of a constant or a parameter is a `Named`, and a `use` is a node of the kind
        "use" with the subtree's name and numbers.
        """
        self._scope = replace(self._scope, named=True, values=dict.fromkeys(parameters, 1.0))
        if tree.data != "use":
            node, subtrees = self._head(tree)
            return node._replace(
                children=tuple([self.written(each, parameters) for each in subtrees])
            )
        name, *arguments = tree.children
        numbers = [self._scope.number(each) for part in arguments for each in part.children]
        return Node("use", UseArgs(str(name), tuple(numbers)))

    def _use(self, tree: _Tree, name: _Token, arguments: Sequence[_Token], level: int) -> Node:
        if name not in self._templates:
            raise self._unknown_subtree(name)
        subtree = self._instance(name, arguments, level)
        self._count(name, nodes=subtree.nodes, deepest=level + subtree.levels - 1)
        self._places.append((subtree, tree))
        if not self._marked:
            return subtree.node
        text = use_text(str(name), [self._scope.number(each) for each in arguments])
        return commented(as_subtree(subtree.node, text), self._scope.source.comments_at(name))

    def _count(self, token: _Token, *, nodes: int, deepest: int) -> None:
        self.nodes += nodes
        self.levels = max(self.levels, deepest)
        too_deep = self._base + self.levels - 1 > MAX_LEVELS
        if too_deep or self.nodes > MAX_NODES:
            raise self._scope.source.error_at(
                token,
                "the tree is too deep" if too_deep else "the tree is too large",
                expected=f"at most {MAX_LEVELS} levels and {MAX_NODES} nodes, each use expanded",
                kind=LimitError,
            )

    def _unknown_subtree(self, name: _Token) -> TreeError:
        names = self._templates
        known = shorten(", ".join(names), 200, placeholder=" ...")
        if name == self._name:
            message = f"subtree {shown(name)} uses itself"
        elif name in self._later:
            message = f"subtree {shown(name)} is defined further down"
        else:
            message = f"unknown subtree {shown(name)}"
        guess = closest(name, names)
        if not guess and self._vocabulary is not None and name in self._vocabulary.actions:
            guess = f"{name}, without use"
        return self._scope.source.error_at(
            name,
            message,
            expected=f"a subtree that is defined above: {known or 'none so far'}",
            guess=guess,
            kind=UnknownNameError,
        )


def _is(tree: _Tree, *rules: str) -> bool:
    return getattr(tree, "data", "") in rules


def _numbers(parameters: Sequence[str]) -> str:
    return f"{len(parameters)} number{'s' * (len(parameters) != 1)}"
