"""Builds single nodes and conditions from parse trees; checks their names, ranges and sizes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

from islandgp.bt.core.arithmetic import (
    Formula,
    Named,
    Operation,
    Term,
    Written,
    bounds,
    is_whole,
    negative,
)
from islandgp.bt.core.condition import Condition, ConditionExpr, combine, comparison, negate
from islandgp.bt.core.kind import Argument, Sort
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.node import ActionArgs, Node, Value
from islandgp.bt.core.parameters import NO_YES, fits, referenced, value_range
from islandgp.bt.core.printer import number_text
from islandgp.bt.core.source import Source, Word, closest, first_word, shown
from islandgp.bt.core.unknown import listing, unknown, unknown_node
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import LimitError, TreeError

MAX_NUMBER: Final = 1_000_000  # largest magnitude of a threshold
MAX_TERMS: Final = 16  # most comparisons and flags of a condition
MAX_OPERANDS: Final = 256  # most keys, numbers and operations in the sums of a condition
MAX_NESTED: Final = 16  # most levels; each `and`, `or`, `not` and `(` adds one

# lark.Tree and lark.Token: trees mix both, at places determined by the grammar.
Tree: TypeAlias = Any
Token: TypeAlias = Any

NUMBER: Final = "a number"
KEY: Final = "a key"
OPERAND: Final = "a number, a key or a word"
VALUE: Final = "a number, a word or a text in quotes"
NODE: Final = "an action or a `use`"
_FITS: Final = {
    NUMBER: ("NUMBER", "NAME"),
    KEY: ("NAME",),
    OPERAND: ("NUMBER", "NAME", "FILE"),
    VALUE: ("NUMBER", "NAME", "FILE"),
    NODE: ("NAME", "NODE"),
}
"""The types of arguments that can be passed for a parameter in a place."""

_PLAIN_NUMBER: Final = re.compile(r"-?[0-9]+(\.[0-9]+)?")


class NodeBuilder:
    """Builds nodes without their children."""

    def __init__(self, vocabulary: Vocabulary | None, *, named: bool = False) -> None:
        """Builds nodes.

        Args:
            vocabulary: the valid actions and keys. None: all names are valid.
            named: keep the words of numbers (`Written`), and arguments as they are written.
        """
        self.source = Source("", "")  # of what is being built
        self.vocabulary = vocabulary
        self.values: Mapping[str, Word] = {}  # the parameters that are known there
        self.constants: dict[str, Word] = {}  # those that are defined so far, with their numbers
        self.subtrees: dict[str, Any] = {}  # those that are defined so far
        self._keys = vocabulary.keys if vocabulary else {}
        self._named = named
        self._terms = self._operands = 0

    def word(self, token: Token, place: str) -> Word:
        """The word of a token, or of the argument that is passed for it.

        `place`: NUMBER, KEY, OPERAND, VALUE or NODE. Raises TreeError unless the word fits there.
        """
        word = self.values.get(token) if token.type == "NAME" else None
        if word is None:
            word = Word(token, self.source, values=self.values)
        if word.type not in _FITS[place]:
            raise word.error(f"unexpected {shown(word.token)}", place)
        return word

    def number(self, token: Token) -> float:
        """A number, or the value of the constant or parameter of that name. Raises TreeError."""
        word = self.word(token, NUMBER)
        if word.type == "NAME" and not word.open:
            if word.text not in self.constants:
                raise self._unknown_number(word)
            word = self.constants[word.text]
        value = 1.0 if word.open else _plain_number(word)
        if not self._named:
            return value
        return Named(str(token), value, word) if token.type == "NAME" else Written(value, word)

    def condition(self, tree: Tree) -> ConditionExpr:
        """The condition of a parse tree. Raises TreeError."""
        self._terms = self._operands = 0
        return self._expression(tree, 1)

    def _expression(self, tree: Tree, level: int) -> ConditionExpr:
        """A condition or a part of one; `level`: of brackets and operators, from 1."""
        rule, parts = str(tree.data), tree.children
        if rule == "flag" and getattr(parts[0], "data", "") == "brackets":
            return self._expression(parts[0], level)
        self._terms += rule in ("flag", "comparison")
        self._check_size(tree, level)
        if rule == "flag":
            return self._flag(parts[0])
        if rule == "comparison":
            return self._comparison(parts, level)
        inside = [self._expression(part, level + 1) for part in parts]
        if rule == "negation":
            return negate(inside[0])
        return combine("and" if rule == "conjunction" else "or", inside)

    def _check_size(self, part: Any, level: int) -> None:
        """Raises LimitError at a part of a condition that makes it too long or too deep."""
        if self._terms > MAX_TERMS or self._operands > MAX_OPERANDS or level > MAX_NESTED:
            raise self.source.error(
                part,
                "the condition is too long",
                f"at most {MAX_TERMS} comparisons and flags, {MAX_OPERANDS} keys, numbers"
                f" and operations, {MAX_NESTED} levels",
                kind=LimitError,
            )

    def _flag(self, part: Any) -> Condition:
        if hasattr(part, "children"):
            raise self.source.error(
                part, "a sum must be compared with a number or a sum", "e.g. `when 0.5 * a + b > 1`"
            )
        name = self.word(part, KEY)
        self._key(name)
        return Condition(name.text, "is", 0.0)

    def _comparison(self, parts: Sequence[Any], level: int) -> Condition:
        left, operator, right = parts
        if hasattr(left, "children") or hasattr(right, "children"):
            term = self._term(left, level)
            if not isinstance(term, str) and not Formula(term).keys:
                raise self.source.error(left, f"unexpected {shown(first_word(left))}", KEY)
            return comparison(term, str(operator), self._term(right, level))
        return self.compare(self.word(left, KEY), str(operator), right)

    def compare(self, name: Word, operator: str, right: Token) -> Condition:
        """The comparison of a key with a number, a word or another key. Raises TreeError."""
        key = self._key(name, operator)
        return Condition(name.text, operator, *self._operand(name, key, right))

    def _operand(self, name: Word, key: Key | None, token: Token) -> tuple[float, str]:
        """What a key is compared with, or set to: a number or a word, or else another key."""
        word = self.word(token, OPERAND)
        words = key.choices if key else ()
        if word.open:
            return 0.0, word.text
        if word.type != "NUMBER" and word.text in words:
            return Named(word.text, words.index(word.text)), ""
        if word.type == "FILE" and key is None:
            return 0.0, f'"{word.text}"'
        if not words and (word.type == "NUMBER" or word.text in self.constants):
            return self.number(token), ""
        other = self._keys.get(word.text)
        is_alike = other and key and other.kind == key.kind and word.text != name.text
        is_alike = is_alike and word.type == "NAME"
        if key is not None and not is_alike:
            raise self._wrong_operand(name.text, key, word)
        return 0.0, word.text

    def _wrong_operand(self, name: str, key: Key, word: Word) -> TreeError:
        """The error for what a key of this name cannot be compared with, or set to."""
        others = [n for n, each in self._keys.items() if each.kind == key.kind and n != name]
        known = [*(key.choices or ("a number", *self.constants)), *others]
        message = f"{shown(word.token)} does not fit {name}, which is {key.kind}"
        return word.error(message, " | ".join(known), guess=closest(word.text, known))

    def _unknown_number(self, word: Word, keys: Sequence[str] = ()) -> TreeError:
        """The error for a name that is no number, where one or a key is expected."""
        names = [*word.values, *self.constants, *keys]
        return unknown(word, "constant", names, expected=f"a number, or one of {listing(names)}")

    def _term(self, tree: Any, level: int) -> Term:
        """A part of a sum. Raises TreeError, also for too many parts."""
        self._operands += 1
        self._check_size(tree, level)
        match getattr(tree, "data", ""), getattr(tree, "children", ()):
            case "", _:
                return self._summand(tree)
            case "negative", [_, part]:
                return negative(self._term(part, level + 1))
            case "brackets", [inside] if inside.data == "flag":
                return self._term(inside.children[0], level + 1)
            case "brackets", _:
                raise self.source.error(
                    tree, "a condition can't be a part of a sum", "keys and numbers"
                )
            case _, [left, sign, right]:
                terms = self._term(left, level), self._term(right, level)
                if sign == "/" and bounds(terms[1], {}) == (0, 0):
                    raise self.source.error(
                        sign, "division by 0", "a number other than 0, or a key"
                    )
                return Operation(str(sign), terms)
        raise AssertionError(tree.data)

    def _summand(self, token: Token) -> Term:
        """A key or a number."""
        word = self.word(token, OPERAND)
        if word.type == "NUMBER" or (word.text in self.constants and not word.open):
            return self.number(token)
        self._key(word, "<")
        return word.text

    def _key(self, name: Word, operator: str = "") -> Key | None:
        """The key of a name; None if it can be any. Raises TreeError unless it can stand there.

        `operator`: with which it is compared; "": it is a condition alone.
        """
        if self.vocabulary is None or name.open:
            return None
        key = self._keys.get(name.text)
        if key is None:
            raise unknown(name, "blackboard key", [*self._keys, *self.values])
        if operator not in (key.operators or ("",)):
            operators = f", with one of {' '.join(key.operators)}" * bool(key.operators)
            expected = f"`when {key.example(name.text)}`{operators}"
            raise name.error(f"{name.text} is {key.kind} and does not fit here", expected)
        return key

    def _assignment(self, tree: Tree) -> Condition:
        """The assignment of a value to a key."""
        token, right = tree.children
        name, key = self.word(token, KEY), None
        if self.vocabulary is not None and not name.open:
            key = self._keys.get(name.text)
            if key is None or not key.writable:
                known = [each for each, other in self._keys.items() if other.writable]
                raise unknown(name, "key with an `initial` value", known)
        if hasattr(right, "children"):
            if key is not None and key.choices:
                raise self._wrong_operand(name.text, key, Word(right, self.source))
            self._operands = 0
            assigned = comparison(name.text, "=", self._term(right, 1))
        elif key is None and right in NO_YES:
            assigned = Condition(name.text, "=", Named(str(right), NO_YES.index(right)))
        else:
            assigned = Condition(name.text, "=", *self._operand(name, key, right))
        self._check_assigned(assigned, key, right)
        return assigned

    def _check_assigned(self, assigned: Condition, key: Key | None, right: Any) -> None:
        """Raises TreeError unless a key can have a value; the range of a sum is not checked."""
        if key is None or key.choices or any(word.open for word in self.values.values()):
            return
        other, number = assigned.other, assigned.number
        whole_keys = {name for name, each in self._keys.items() if each.whole}
        term = other.term if isinstance(other, Formula) else other
        is_fit = not key.whole or is_whole(term, whole_keys) if other else key.can_be(number)
        if not is_fit:
            message = f"{assigned.key} can't be {other or number_text(number)}"
            raise self.source.error(right, message, key.values)

    def head(self, tree: Tree) -> tuple[Node, Sequence[Tree]]:
        """A node but a `use`, without its children, and the parse trees of these.

        Raises:
            TreeError: a name is unknown or a value is out of its range.
        """
        kind, parts = str(tree.data), tree.children
        if kind == "action":
            pairs = [each.children for part in parts[1:] for each in part.children]
            return self.leaf(self.word(parts[0], NODE), pairs), ()
        arguments: list[Any] = []
        rest = list(parts[1:])
        for argument in KINDS[kind].arguments:
            if argument.default is None:
                arguments.append(self._argument(kind, argument, rest.pop(0)))
            elif rest and getattr(rest[0], "data", "") == argument.name:
                arguments.append(self._argument(kind, argument, rest.pop(0).children[0]))
            else:
                arguments.append(argument.default)
        return Node(kind, KINDS[kind].args(*arguments)), rest

    def leaf(self, name: Word, pairs: Sequence[tuple[Token, Token]]) -> Node:
        """A leaf from its name, and the names and values of its arguments. Raises TreeError."""
        if self.vocabulary is not None and name.text not in self.vocabulary.actions:
            raise unknown_node(name, self.subtrees, self.vocabulary, self.values)
        values: dict[str, Value] = {}
        for key, value in pairs:
            if key in values:
                raise self.source.error(
                    key, f"argument {shown(key)} is given twice", "each argument once"
                )
            values[str(key)] = self._value(name.text, key, value)
        if self.vocabulary is None or self._named:
            return Node("action", ActionArgs(name.text, tuple(values.items())))
        return self.vocabulary.leaf(name.text, values)

    def _value(self, action: str, key: Token, token: Token) -> Value:
        """The value of an action's argument; without a vocabulary any word is one."""
        word = self.word(token, VALUE)
        if self.vocabulary is None:
            if word.type == "NUMBER" or (word.type == "NAME" and word.text in self.constants):
                return self.number(token)
            is_defined = word.text in self.values or word.text in self.constants
            keeps_quotes = self._named and word.type == "FILE" and is_defined
            return f'"{word.text}"' if keeps_quotes else word.text
        parameters = self.vocabulary.actions[action].arguments
        if key not in parameters:
            ranges = "; ".join(f"{name}: {value_range(each)}" for name, each in parameters.items())
            expected = ranges or f"`{action}` alone"
            word = Word(key, self.source)
            raise unknown(word, "argument", parameters, of=action, expected=expected)
        parameter = parameters[key]
        if word.open:
            return parameter.default
        key_name = referenced(word.text) if word.type == "FILE" else ""
        if key_name and self.vocabulary.gives(key_name, parameter):
            return word.text
        value = self.number(token) if parameter.numeric else word.text
        if not fits(parameter, value):
            raise word.error(
                f"{shown(word.token)} is not a value of {key}",
                value_range(parameter),
                guess=closest(word.token, parameter.words),
            )
        return value

    def _amount(self, token: Token, sort: Sort) -> str:
        """The key that is named in place of a count or seconds; "" for a number. Raises TreeError.

        A number of which no constant has the name is the value of a key.
        """
        word = self.word(token, NUMBER)
        if word.type != "NAME" or word.open or word.text in self.constants:
            return ""
        numbers = {n: k for n, k in self._keys.items() if not k.choices}
        keys = [n for n, k in numbers.items() if k.whole or sort is Sort.SECONDS]
        if self.vocabulary is not None and word.text not in keys:
            raise self._unknown_number(word, keys)
        return word.text

    def _argument(self, kind: str, argument: Argument, part: Any) -> ConditionExpr | float | str:
        """The value of a node's argument."""
        if argument.sort is Sort.CONDITION:
            return self.condition(part)
        if argument.sort is Sort.ASSIGNMENT:
            return self._assignment(part)
        if part.type not in ("NAME", "NUMBER"):  # one of its words
            return str(part)
        if argument.sort is not Sort.POLICY and (key := self._amount(part, argument.sort)):
            return key
        number, (low, high) = self.number(part), argument.range
        is_whole_number = argument.sort is not Sort.SECONDS
        if not low <= number <= high or (is_whole_number and number % 1):
            word = self.word(part, NUMBER)
            raise word.error(
                f"a {kind} can't have {shown(word.token)} as its {argument.name}",
                f"a {'whole ' * is_whole_number}number from {low:g} to {high:,}",
            )
        return int(number) if is_whole_number and not self._named else number


def _plain_number(word: Word) -> float:
    """The value of a number in a text. Raises TreeError."""
    if not _PLAIN_NUMBER.fullmatch(word.token):
        raise word.error(
            f"{shown(word.token)} is not a plain number",
            "digits with an optional decimal point and no unit: 25, 12.5 or -3",
        )
    value = float(word.token) + 0.0  # turns -0.0 into 0.0
    if abs(value) > MAX_NUMBER:
        raise word.error(
            f"{shown(word.token)} is out of range", f"a number from {-MAX_NUMBER} to {MAX_NUMBER}"
        )
    return value
