"""Builds single nodes from parse trees; checks the names and ranges of their arguments."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, TypeAlias

from islandgp.bt.core.condition import ConditionExpr
from islandgp.bt.core.condition_builder import built_condition
from islandgp.bt.core.kinds import KINDS, Argument, Sort
from islandgp.bt.core.node import ActionArgs, Node, UseArgs, Value
from islandgp.bt.core.parameters import fits, value_range
from islandgp.bt.core.printer import Quoted, head, number_text
from islandgp.bt.core.scope import Scope
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import UnknownNameError

# lark.Tree and lark.Token: trees mix both, at places determined by the grammar.
_Tree: TypeAlias = Any
_Token: TypeAlias = Any


def built_head(
    tree: _Tree, scope: Scope, vocabulary: Vocabulary | None, subtrees: Collection[str]
) -> tuple[Node, Sequence[_Tree]]:
    """A node without its children, and the parse trees of these.

    Args:
        tree: of any node but a `use`.
        scope: the names that are known there.
        vocabulary: the valid actions and keys. None: all names are valid.
        subtrees: the names of subtrees that are known, for guesses.

    Raises:
        TreeError: a name is unknown or a value is out of its range.
    """
    kind, parts = str(tree.data), tree.children
    if kind == "action":
        values = [each.children for part in parts[1:] for each in part.children]
        return built_leaf(parts[0], values, scope, vocabulary, subtrees), ()
    arguments: list[Any] = []
    rest = list(parts[1:])
    for argument in KINDS[kind].arguments:
        is_given = argument.default is None or getattr(rest[0], "data", "") == argument.name
        arguments.append(
            _argument(kind, argument, rest.pop(0), scope, vocabulary)
            if is_given
            else argument.default
        )
    return Node(kind, KINDS[kind].make_args(arguments)), rest


def built_leaf(
    name: _Token,
    arguments: Sequence[tuple[_Token, _Token]],
    scope: Scope,
    vocabulary: Vocabulary | None,
    subtrees: Collection[str],
) -> Node:
    """A leaf from the names and values of its arguments. Raises as `built_head`."""
    values: dict[str, Value] = {}
    if vocabulary is not None and name not in vocabulary.actions:
        from islandgp.bt.core.unknown_names import unknown_node  # only for this error

        raise unknown_node(scope.word(name), subtrees, vocabulary, scope.values)
    for key, value in arguments:
        if key in values:
            raise scope.source.error_at(
                key, f"argument {shown(key)} is given twice", expected="each argument once"
            )
        values[str(key)] = _value(name, key, value, scope, vocabulary)
    if vocabulary is None or scope.named:
        return Node("action", ActionArgs(str(name), tuple(values.items())))
    return vocabulary.leaf(str(name), values)


def written_node(tree: _Tree, scope: Scope) -> Node:
    """A tree as it is written; its text has been built without an error.

    The number of a constant or a parameter is a `Named`, and a `use` is a node of the kind
    "use" with the subtree's name and arguments.
    """
    if tree.data != "use":
        node, subtrees = built_head(tree, scope, None, ())
        return node._replace(children=tuple([written_node(each, scope) for each in subtrees]))
    name, *arguments = tree.children
    texts = [_written_argument(each, scope) for part in arguments for each in part.children]
    return Node("use", UseArgs(str(name), tuple(texts)))


def _written_argument(argument: Any, scope: Scope) -> str:
    if hasattr(argument, "data"):
        return head(written_node(argument, scope))
    return number_text(scope.number(argument)) if argument.type == "NUMBER" else str(argument)


def _value(
    action: _Token, key: _Token, token: _Token, scope: Scope, vocabulary: Vocabulary | None
) -> Value:
    """The value of an action's argument; without a vocabulary any word is one."""
    word = scope.word(token)
    if vocabulary is None:
        if token.type == "NUMBER" or word.number is not None:
            return scope.number(token)
        quoted = scope.named and token.type != "NAME" and scope.has_name(word.text)
        return Quoted(word.text) if quoted else word.text
    parameters = vocabulary.actions[action].arguments
    if key not in parameters:
        from islandgp.bt.core.unknown_names import unknown_argument  # only for this error

        raise unknown_argument(scope.source, key, action, parameters)
    parameter = parameters[key]
    if word.open:
        return parameter.default
    value = scope.number(token) if parameter.numeric else word.text
    if not fits(parameter, value):
        raise word.error(
            f"{shown(word.token)} is not a value of {key}",
            expected=value_range(parameter),
            guess=closest(word.token, parameter.words),
        )
    return value


def _argument(
    kind: str, argument: Argument, tree: _Tree, scope: Scope, vocabulary: Vocabulary | None
) -> ConditionExpr | float | str:
    """The value of a node's argument from its parse tree."""
    if argument.sort is Sort.CONDITION:
        return built_condition(tree, scope, vocabulary)
    if argument.sort is Sort.SECONDS:
        return scope.seconds(kind, argument, tree)
    if argument.sort is Sort.COUNT:
        return scope.count_of(argument, tree, f"a {kind} can't repeat {{}} times")
    word = tree.children[0]
    if word.type == "NAME" and scope.word(word).number is None:
        raise scope.source.error_at(
            word,
            f"unexpected {shown(word)}",
            expected=f"one of: {' '.join(sorted(argument.words))}, or a whole number",
            guess=closest(word, argument.words),
            kind=UnknownNameError,
        )
    if word.type in ("NAME", "NUMBER"):
        return scope.count_of(
            argument, word, f"{{}} is not a number of children for {argument.name}"
        )
    return str(word)
