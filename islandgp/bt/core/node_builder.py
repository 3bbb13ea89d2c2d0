"""Builds single nodes and conditions from parse trees; checks their names, ranges and sizes."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import inf
from typing import Any, Final, TypeAlias

from islandgp.bt.core.arithmetic import Formula, Named, Operation, Term, bounds, is_whole, negative
from islandgp.bt.core.condition import Condition, ConditionExpr, combine, comparison, negate
from islandgp.bt.core.kind import Argument, Sort
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.node import ActionArgs, Node, UseArgs, Value
from islandgp.bt.core.parameters import NO_YES, fits, referenced, value_range
from islandgp.bt.core.printer import Quoted, head, number_text
from islandgp.bt.core.scope import Scope, ScopedWord
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import LimitError, TreeError, UnknownNameError

MAX_TERMS: Final = 16  # most comparisons and flags of a condition
MAX_OPERANDS: Final = 256  # most keys, numbers and operations in the sums of a condition
MAX_NESTED: Final = 16  # most levels; each `and`, `or`, `not` and `(` adds one

# lark.Tree and lark.Token: trees mix both, at places determined by the grammar.
_Tree: TypeAlias = Any
_Token: TypeAlias = Any


def built_condition(tree: _Tree, scope: Scope, vocabulary: Vocabulary | None) -> ConditionExpr:
    """The condition of a parse tree; without a vocabulary all keys are valid. Raises TreeError."""
    return _ConditionBuilder(scope, vocabulary).expression(tree, 1)


class _ConditionBuilder:
    """Builds one condition and counts its terms."""

    def __init__(self, scope: Scope, vocabulary: Vocabulary | None) -> None:
        self._scope = scope
        self._vocabulary = vocabulary
        self._terms = self._operands = 0

    def expression(self, tree: _Tree, level: int) -> ConditionExpr:
        """A condition or a part of one; `level`: of brackets and operators, from 1."""
        form, parts = str(tree.data), tree.children
        if form == "flag" and getattr(parts[0], "data", "") == "brackets":
            return self.expression(parts[0], level)
        if form in ("comparison", "flag"):
            self._terms += 1
            first = _first_word(tree)
            self._bounded(first, level)
            if first is not parts[0] or hasattr(parts[-1], "children"):
                return self._calculated(first, parts, level)
            if first.type == "NUMBER":
                raise self._keyless(first)
            name, compared = self._scope.word(first), parts[1:]
            key = self._key(name, *compared[1:])
            if form == "flag":
                return Condition(name.text, "is", 0.0)
            return self._comparison(name, key, *compared)
        self._bounded(_first_word(tree), level)
        inside = [self.expression(part, level + 1) for part in parts]
        if form == "negation":
            return negate(inside[0])
        if form == "brackets":
            return inside[0]
        return combine("and" if form == "conjunction" else "or", inside)

    def _comparison(
        self, name: ScopedWord, key: Key | None, operator: _Token, right: _Token
    ) -> Condition:
        if key is not None and operator not in key.operators:
            message = f"{name.text} is {key.kind} and can't be compared by {shown(operator)}"
            at = name if name.parameter else ScopedWord(operator, self._scope.source)
            raise at.error(message, expected=f"one of: {' '.join(key.operators)}")
        word = self._scope.word(right)
        if word.open:
            return Condition(name.text, str(operator), 0.0, word.text)
        if key is not None and word.text in key.words:
            return Condition(name.text, str(operator), key.number_of(word.text))
        is_name = word.token.type == "NAME"
        if is_name and (word.number is None or (key is not None and key.words)):
            self._check_other(name, key, word)
            return Condition(name.text, str(operator), 0.0, word.text)
        if key is not None and key.words:
            from islandgp.bt.core.unknown_names import unknown_word  # only for this error

            raise unknown_word(word, name.text, key, self._comparable(name.text))
        value = self._scope.number(right)
        return Condition(name.text, str(operator), value)

    def _calculated(self, first: _Token, parts: Sequence[Any], level: int) -> Condition:
        """A comparison with an operation on either side."""
        if len(parts) == 1:
            raise self._scope.source.error_at(
                first,
                "a sum must be compared with a number or a sum",
                expected="e.g. `when 0.5 * a + b > 1`",
            )
        left, operator, right = parts
        term = self._term(left, level)
        compared = comparison(term, str(operator), self._term(right, level))
        if not isinstance(term, str) and not Formula(term).keys:
            raise self._keyless(first)
        return compared

    def _term(self, tree: Any, level: int) -> Term:
        """A part of a sum. Raises TreeError, also for too many parts."""
        at = _first_word(tree)
        self._operands += 1
        if self._operands > MAX_OPERANDS or level > MAX_NESTED:
            raise self._scope.source.error_at(
                at,
                "the sum is too long",
                expected=f"at most {MAX_OPERANDS} keys, numbers and operations in a condition,"
                f" {MAX_NESTED} levels",
                kind=LimitError,
            )
        form = getattr(tree, "data", "")
        if form == "negative":
            return negative(self._term(tree.children[1], level + 1))
        if form == "brackets" and tree.children[0].data == "flag":
            return self._term(tree.children[0].children[0], level + 1)
        if form == "brackets":
            raise self._scope.source.error_at(
                at, "a condition can't be a part of a sum", expected="keys and numbers"
            )
        if form:
            left, sign, right = tree.children
            terms = self._term(left, level), self._term(right, level)
            if sign == "/" and bounds(terms[1], {}) == (0, 0):
                raise self._scope.source.error_at(
                    sign, "division by 0", expected="a number other than 0, or a key"
                )
            return Operation(str(sign), terms)
        word = self._scope.word(tree)
        if word.token.type == "NUMBER" or word.number is not None:
            return self._scope.number(tree)
        if not word.open and self._vocabulary is not None:
            key = self._vocabulary.keys.get(word.text)
            if key is None:
                keys = [n for n, k in self._vocabulary.keys.items() if not (k.flag or k.words)]
                raise self._scope.unknown_number(word, keys)
            if key.flag or key.words:
                raise word.error(
                    f"{word.text} is {'a flag' if key.flag else key.kind} and can't be a part of a"
                    " sum",
                    expected="keys that are numbers, and numbers",
                )
        return word.text

    def _keyless(self, first: _Token) -> TreeError:
        keys = ", ".join(self._vocabulary.keys if self._vocabulary else ())
        return self._scope.source.error_at(
            first,
            f"unexpected {shown(first)}; a comparison begins with its key",
            expected="a key" + f": {keys}" * bool(keys),
        )

    def assignment(self, token: _Token, right: Any) -> Condition:
        """The assignment of a value to a key."""
        name, word = self._scope.word(token), self._scope.word(_first_word(right))
        single = not hasattr(right, "children")
        key = None
        if self._vocabulary is not None and not name.open:
            key = self._vocabulary.keys.get(name.text)
            if key is None or not key.writable:
                from islandgp.bt.core.unknown_names import unwritable  # only for this error

                raise unwritable(name, self._vocabulary)
        if single and word.text in NO_YES and (key is None or key.flag):
            return Condition(name.text, "=", Named(word.text, NO_YES.index(word.text)))
        keys = self._vocabulary.keys if self._vocabulary else {}
        if key is not None and (key.flag or (key.words and not single)):
            alike = [n for n, each in keys.items() if each.kind == key.kind]
            if not single or not (word.open or word.text in alike):
                raise word.error(
                    f"{name.text} is {key.kind}",
                    expected=f"{' or '.join(key.words or NO_YES)}, or a key: {', '.join(alike)}",
                )
            return Condition(name.text, "=", 0.0, word.text)
        if single:
            assigned = self._comparison(name, key, "==", right)._replace(operator="=")
        else:
            assigned = comparison(name.text, "=", self._term(right, 1))
        self._check_assigned(assigned, key, word)
        return assigned

    def _check_assigned(self, assigned: Condition, key: Key | None, word: ScopedWord) -> None:
        """Raises TreeError unless a key can have a value; the range of a sum is not checked."""
        if key is None or key.words or self._vocabulary is None or word.open:
            return
        low, most, other = key.low, inf if key.most is None else key.most, assigned.other
        whole_keys = {name for name, each in self._vocabulary.keys.items() if each.whole}
        term = other.term if isinstance(other, Formula) else other or assigned.number
        if (not other and not low <= assigned.number <= most) or (
            key.whole and not is_whole(term, whole_keys)
        ):
            kind = "a whole number" if key.whole else "a number"
            raise word.error(
                f"{assigned.key} can't be {other or number_text(assigned.number)}",
                expected=f"{kind} of at least {low:g}" + f" and at most {most:g}" * (most < inf),
            )

    def _comparable(self, name: str) -> list[str]:
        is_key = self._vocabulary is not None and name in self._vocabulary.keys
        return self._vocabulary.comparable(name) if self._vocabulary and is_key else []

    def _check_other(self, name: ScopedWord, key: Key | None, right: ScopedWord) -> None:
        """Raises TreeError unless a key can be compared with the word on the right, a key."""
        if right.text == name.text:
            raise right.error(
                f"{name.text} is compared with itself", expected="another key, or a value"
            )
        if key is None or self._vocabulary is None:
            return
        keys = self._vocabulary.keys
        alike = self._comparable(name.text)
        if right.text in alike:
            return
        if right.text in keys:
            raise right.error(
                f"{name.text} is {key.kind} and {right.text} is {keys[right.text].kind}; they can't"
                " be compared",
                expected=key.kind
                + f", or a key of the same kind: {', '.join(alike)}" * bool(alike),
            )
        if key.words:
            from islandgp.bt.core.unknown_names import unknown_word  # only for this error

            raise unknown_word(right, name.text, key, alike)
        raise self._scope.unknown_number(right, alike)

    def _bounded(self, at: _Token, level: int) -> None:
        if self._terms > MAX_TERMS or level > MAX_NESTED:
            raise self._scope.source.error_at(
                at,
                "the condition is too long" if level <= MAX_NESTED else "the condition is too deep",
                expected=f"at most {MAX_TERMS} comparisons and flags, {MAX_NESTED} levels",
                kind=LimitError,
            )

    def _key(self, name: ScopedWord, right: _Token | None = None) -> Key | None:
        """The key of a name; None if it can be any. Raises TreeError for a wrong one.

        `right`: what it is compared with; None: it is not compared.
        """
        vocabulary = self._vocabulary
        if vocabulary is None or name.open:
            return None
        key = vocabulary.keys.get(name.text)
        if key is None:
            from islandgp.bt.core.unknown_names import unknown_key  # only for this error

            raise unknown_key(name, vocabulary, self._scope.values)
        if key.flag and right is not None:
            is_number = right.type != "NAME"
            raise name.error(
                f"{name.text} is a flag and can't be compared{' with a number' * is_number}",
                expected=f"`when {name.text}` or `when not {name.text}`; flags are joined by and,"
                " or",
            )
        if not key.flag and right is None:
            raise name.error(
                f"{name.text} is {key.kind} and must be compared with one",
                expected=f"`when {key.example(name.text)}`, with one of {' '.join(key.operators)}",
            )
        return key


def _first_word(tree: _Tree) -> _Token:
    while hasattr(tree, "children"):
        tree = tree.children[0]
    return tree


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
    if token.type == "FILE" and (name := referenced(word.text)):
        if not vocabulary.gives(name, parameter):
            keys = [n for n in vocabulary.keys if vocabulary.gives(n, parameter)]
            raise word.error(
                f"{name} is not a key whose value {key} can have",
                expected=f"a key: {', '.join(keys) or 'none'}; or {value_range(parameter)}",
                guess=closest(name, keys),
            )
        return word.text
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
    if argument.sort is Sort.ASSIGNMENT:
        return _ConditionBuilder(scope, vocabulary).assignment(*tree.children)
    if argument.sort is Sort.SECONDS:
        return scope.seconds(kind, argument, tree)
    if argument.sort is Sort.COUNT:
        return scope.count_of(argument, tree, f"a {kind} can't repeat {{}} times")
    if argument.default is None:
        return str(tree)
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
