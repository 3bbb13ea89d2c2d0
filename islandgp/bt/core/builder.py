"""Builds nodes from parse trees; checks names, numbers and sizes, which the grammar does not."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import replace
from textwrap import shorten
from typing import Any, Final, NamedTuple, TypeAlias

from islandgp.bt.core.condition import ConditionExpr
from islandgp.bt.core.includes import ParsedFile
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.node import Node, as_subtree, commented, leaf, names_of, sequence
from islandgp.bt.core.node_builder import built_condition, built_head, built_leaf, written_node
from islandgp.bt.core.printer import head, number_text, use_text
from islandgp.bt.core.scope import (
    ANYTHING,
    NODE,
    BuiltSubtree,
    ParameterType,
    Scope,
    ScopedWord,
    Template,
    check_form,
    check_name,
    parameter_types,
)
from islandgp.bt.core.source import Source, closest, shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import LimitError, TreeError, UnknownNameError

MAX_LEVELS: Final = 100  # of a tree, a `use` counted expanded
MAX_NODES: Final = 10_000  # of a tree, a `use` counted expanded
MAX_INSTANCES: Final = 1_000  # most combinations of subtrees and arguments

# lark.Tree and lark.Token: trees mix both, at places determined by the grammar.
_Tree: TypeAlias = Any
_Token: TypeAlias = Any

NO_TREE: Final = sequence()
"""Result for a file that only has definitions: a sequence without children."""


class SourceSpan(NamedTuple):
    """The place of a node in its file."""

    line: int  # from 1
    column: int
    origin: int  # the same for all uses of a node of a subtree
    uses: tuple[tuple[int, int], ...] = ()  # places of the uses around it, the outermost first


class Builder:
    """Builds the tree of one text.

    Sizes are counted while building, with a `use` as large as its subtree, so subtrees that double
    each other are rejected before they are expanded.
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
        self._later: set[str] = set()  # subtrees that are not yet defined
        self.nodes = 0  # of the tree that is being built, so far
        self.levels = 0
        self._templates: dict[str, Template] = {}
        self._instances: dict[tuple[Hashable, ...], BuiltSubtree] = {}
        self._open = 0  # subtrees with parameters, and arguments, that are being built
        self._base = 1  # level of the root of what is being built
        self._name = ""  # of the subtree that is being built
        self._places: list[Any] = []  # of the tree that is being built

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
        names: set[str] = set()
        for parameter in parameters:
            if parameter in names:
                raise self._scope.source.error_at(
                    parameter,
                    f"parameter {shown(parameter)} is defined twice",
                    expected="a new name",
                )
            names.add(str(parameter))
        # Built once with open parameters, to find errors in the definition.
        outside, source = self._scope, self._scope.source
        fitting = parameter_types(parameters, body, self._templates, source)
        self._scope = replace(outside, values={str(p): _open(p, source) for p in parameters})
        tree = self._finished(self._whole(body, name))
        self._templates[str(name)] = Template(fitting, body, tree)
        self._scope = outside
        self._later.discard(str(name))

    def _instance(self, name: _Token, arguments: Sequence[Any], level: int) -> BuiltSubtree:
        """The subtree with these arguments; each is built once."""
        template = self._templates[str(name)]
        self._check_arguments(name, arguments, template)
        if not arguments:
            return template.tree
        values: dict[str, ScopedWord] = {}
        pairs = zip(template.parameters.items(), arguments, strict=True)
        for (parameter, fitting), argument in pairs:
            value = self._passed(argument, fitting, f"{parameter} of {name}", level)
            values[parameter] = value
            if fitting == ANYTHING and value.part:  # it counts, although it is left out
                self._count(value.token, nodes=value.part.nodes, deepest=level)
        key = (str(name), *map(_identity, values.values()))
        if key not in self._instances:
            if len(self._instances) >= MAX_INSTANCES:
                raise self._too_many(name)
            outside = self._scope
            self._scope = replace(outside, source=template.tree.source, values=values)
            self._instances[key] = self._inner(template.body, name, str(name), level)
            self._scope = outside
        return self._instances[key]

    def _check_arguments(self, name: _Token, arguments: Sequence[Any], template: Template) -> None:
        """Raises TreeError unless there is an argument for each parameter."""
        source, parameters = self._scope.source, template.parameters
        if arguments and not parameters:
            raise source.error_at(
                name, f"subtree {shown(name)} takes no arguments", expected=f"`use {name}`"
            )
        if len(arguments) != len(parameters):
            count = f"{len(parameters)} argument{'s' * (len(parameters) != 1)}"
            raise source.error_at(
                name,
                f"subtree {name} takes {count}, found {len(arguments)}",
                expected=f"`use {name}({', '.join(parameters)})`",
            )

    def _passed(
        self, argument: Any, fitting: ParameterType, parameter: str, level: int
    ) -> ScopedWord:
        """The argument that is passed for a parameter; `parameter`: as messages call it."""
        if hasattr(argument, "data"):  # an action with arguments, or a use
            word = ScopedWord(argument.children[0], self._scope.source, parameter=parameter)
            check_form(word, "node", fitting, self._vocabulary)
            return replace(word, part=self._inner(argument, word.token, self._name, level))
        if argument in self._scope.values:
            return self._scope.values[argument]
        word = replace(self._scope.word(argument), parameter=parameter)
        if argument.type != "NAME":
            form = "number" if argument.type == "NUMBER" else "text"
            check_form(word, form, fitting, self._vocabulary)
            return replace(word, number=self._scope.number(argument)) if form == "number" else word
        check_name(word, fitting, self._scope, self._vocabulary, self._templates)
        if fitting != NODE:
            return word
        node = built_leaf(argument, (), self._scope, self._vocabulary, self._templates)
        return replace(word, part=BuiltSubtree(node, 1, 1, [argument], self._scope.source))

    def _inner(self, tree: _Tree, word: _Token, name: str, level: int) -> BuiltSubtree:
        """Build a tree inside the tree that is being built, with its root on `level`."""
        if self._open >= MAX_LEVELS:
            raise self._too_many(word)
        outside = self._name, self._base, self.nodes, self.levels, self._places
        self._open += 1
        built = self._finished(self._whole(tree, name, self._base + level - 1))
        self._open -= 1
        self._name, self._base, self.nodes, self.levels, self._places = outside
        return built

    def _too_many(self, word: _Token) -> TreeError:
        return self._scope.source.error_at(
            word,
            "subtrees are used with too many arguments",
            expected=f"at most {MAX_INSTANCES} different ones, {MAX_LEVELS} in each other",
            kind=LimitError,
        )

    def _finished(self, node: Node) -> BuiltSubtree:
        return BuiltSubtree(node, self.nodes, self.levels, self._places, self._scope.source)

    def _whole(self, tree: _Tree, name: str = "", base: int = 1) -> Node:
        """Build a tree whose root is on the level `base` of the whole tree."""
        self.nodes = self.levels = 0
        self._name, self._base, self._places = name, base, []
        return self._node(tree, 1)

    def places(self) -> list[SourceSpan]:
        """The place of each node of the built tree, in document order.

        A node of an included subtree has the place of its use. The parse trees must be placed.
        """
        places: list[SourceSpan] = []
        inside: list[tuple[Iterator[Any], tuple[int, int] | None, tuple[tuple[int, int], ...]]]
        inside = [(iter(self._places), None, ())]
        while inside:
            rest, at, uses = inside[-1]
            for each in rest:
                if isinstance(each, tuple):
                    subtree, use = each
                    own = subtree.source is self._scope.source
                    here = (use.meta.line, use.meta.column)
                    around = uses if at else (*uses, here)  # a use in an included file has no place
                    inside.append((iter(subtree.places), at or (None if own else here), around))
                    break
                line, column = at or (each.line, each.column)
                places.append(SourceSpan(line, column, id(each), uses))
            else:
                inside.pop()
        return places

    def _node(self, tree: _Tree, level: int) -> Node:
        kind, parts = str(tree.data), tree.children
        try:
            if kind == "use":
                return self._use(tree, parts[0], parts[1].children if parts[1:] else [], level)
            if kind == "action" and parts[0] in self._scope.values:
                return self._placed(tree, *parts, level=level)
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
        return built_head(tree, self._scope, self._vocabulary, self._templates)

    def written_tree(self, tree: _Tree, parameters: Sequence[_Token]) -> Node:
        """`written_node` of what has been built, in a subtree with these parameters."""
        source = self._scope.source
        own = {str(each): ScopedWord(each, source, 1.0) for each in parameters}
        return written_node(tree, replace(self._scope, named=True, values=own))

    def _placed(self, tree: _Tree, name: _Token, *values: _Tree, level: int) -> Node:
        """The action or subtree that is passed for a parameter, at the parameter's place."""
        if values:
            raise self._scope.source.error_at(
                name, f"parameter {shown(name)} takes no arguments", expected=f"`{name}` alone"
            )
        part = self._scope.values[name].part
        self._count(name, nodes=part.nodes, deepest=level + part.levels - 1)
        self._places.append((part, tree))
        comments = self._scope.source.comments_at(name) if self._marked else ()
        return commented(part.node, comments)

    def _use(self, tree: _Tree, name: _Token, arguments: Sequence[_Token], level: int) -> Node:
        if name not in self._templates:
            raise self._unknown_subtree(name)
        subtree = self._instance(name, arguments, level)
        self._count(name, nodes=subtree.nodes, deepest=level + subtree.levels - 1)
        self._places.append((subtree, tree))
        if not self._marked:
            return subtree.node
        text = use_text(str(name), [self._argument_text(each) for each in arguments])
        return commented(as_subtree(subtree.node, text), self._scope.source.comments_at(name))

    def _argument_text(self, argument: Any) -> str:
        """An argument in the name of a subtree; of a subtree that is passed, its name alone."""
        if hasattr(argument, "data"):
            name = argument.children[0]
            return f"use {name}" if argument.data == "use" else head(self._head(argument)[0])
        word = self._scope.word(argument)
        if word.part:
            (text,) = names_of(word.part.node)[:1] or (head(word.part.node),)
            return text.partition("(")[0]
        is_number = word.number is not None or argument.type == "NUMBER"
        return number_text(self._scope.number(argument)) if is_number else word.text

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
        listing = shorten(", ".join(names), 200, placeholder=" ...")
        if name == self._name:
            message = f"subtree {shown(name)} uses itself"
        elif name in self._later:
            message = f"subtree {shown(name)} is defined further down"
        else:
            message = f"unknown subtree {shown(name)}"
        guess = closest(name, names)
        if not guess and self._vocabulary is not None and name in self._vocabulary.actions:
            guess = f"{name}, without use"
        if name in self._scope.values:
            message = f"{shown(name)} is a parameter"
            guess = f"{name}, without use"
        return self._scope.source.error_at(
            name,
            message,
            expected=f"a subtree that is defined above: {listing or 'none so far'}",
            guess=guess,
            kind=UnknownNameError,
        )


def _is(tree: _Tree, *rules: str) -> bool:
    return getattr(tree, "data", "") in rules


def _open(parameter: _Token, source: Source) -> ScopedWord:
    """A parameter of the subtree that is being defined, with a number that fits everywhere."""
    part = BuiltSubtree(leaf(str(parameter)), 1, 1, [parameter], source)
    return ScopedWord(parameter, source, 1.0, open=True, part=part)


def _identity(argument: ScopedWord) -> Hashable:
    """Equal for arguments with which a subtree is the same, including its places."""
    if argument.open:
        return None
    if argument.part is not None:
        # A subtree is kept as long as its identity is needed, a leaf is not.
        places = [id(each[0]) for each in argument.part.places if isinstance(each, tuple)]
        return id(argument.token), *(places or [argument.part.node])
    return argument.number, argument.token.type == "NUMBER" or str(argument.token)
