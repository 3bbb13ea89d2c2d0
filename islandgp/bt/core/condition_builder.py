"""Builds conditions from parse trees; checks their keys, operators and sizes."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

from islandgp.bt.core.condition import Condition, ConditionExpr, combine, negate
from islandgp.bt.core.diagnosis import unknown_key, unknown_word
from islandgp.bt.core.scope import Scope
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import LimitError

MAX_TERMS: Final = 16  # comparisons and flags of a condition
MAX_NESTED: Final = 16  # levels of a condition: each `and`, `or`, `not` and `(` adds one

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
        self._terms = 0

    def expression(self, tree: _Tree, level: int) -> ConditionExpr:
        """A condition or a part of one; `level`: of brackets and operators, from 1."""
        form, parts = str(tree.data), tree.children
        if form in ("comparison", "flag"):
            self._terms += 1
            self._bounded(parts[0], level)
            if self._vocabulary is not None:
                self._check_key(parts[0], compared=form == "comparison", words=self._vocabulary)
            if form == "flag":
                return Condition(str(parts[0]), "is", 0.0)
            return self._comparison(*parts)
        self._bounded(_first_word(tree), level)
        inside = [self.expression(part, level + 1) for part in parts]
        if form == "negation":
            return negate(inside[0])
        if form == "brackets":
            return inside[0]
        return combine("and" if form == "conjunction" else "or", inside)

    def _comparison(self, name: _Token, operator: _Token, right: _Token) -> Condition:
        key = None if self._vocabulary is None else self._vocabulary.keys[name]
        if key is not None and operator not in key.operators:
            raise self._scope.source.error_at(
                operator,
                f"{name} is {key.kind} and can't be compared by {shown(operator)}",
                expected=f"one of: {' '.join(key.operators)}",
            )
        if key is not None and right in key.words:
            return Condition(str(name), str(operator), key.number_of(right))
        known = self._scope.knows(right)
        if right.type == "NAME" and (not known or (key is not None and key.words)):
            self._check_other(name, key, right)
            return Condition(str(name), str(operator), 0.0, str(right))
        if key is not None and key.words:
            raise unknown_word(self._scope.source, right, name, key, self._comparable(name))
        value = self._scope.number(right)
        if key is not None and key.whole and value != int(value):
            raise self._scope.source.error_at(
                right,
                f"{name} is a whole number and can't be compared with {shown(right)}",
                expected="a number without decimals",
            )
        return Condition(str(name), str(operator), value)

    def _comparable(self, name: str) -> list[str]:
        return [] if self._vocabulary is None else self._vocabulary.comparable(name)

    def _check_other(self, name: _Token, key: Key | None, right: _Token) -> None:
        """Raises TreeError unless a key can be compared with the word on the right, a key."""
        if right == name:
            raise self._scope.source.error_at(
                right, f"{name} is compared with itself", expected="another key, or a value"
            )
        if key is None or self._vocabulary is None:
            return
        keys = self._vocabulary.keys
        alike = self._comparable(name)
        if right in alike:
            return
        if right in keys:
            raise self._scope.source.error_at(
                right,
                f"{name} is {key.kind} and {right} is {keys[right].kind}; they can't be compared",
                expected=key.kind
                + f", or a key of the same kind: {', '.join(alike)}" * bool(alike),
            )
        if key.words:
            raise unknown_word(self._scope.source, right, name, key, alike)
        raise self._scope.unknown_number(right, alike)

    def _bounded(self, at: _Token, level: int) -> None:
        if self._terms > MAX_TERMS or level > MAX_NESTED:
            raise self._scope.source.error_at(
                at,
                "the condition is too long" if level <= MAX_NESTED else "the condition is too deep",
                expected=f"at most {MAX_TERMS} comparisons and flags, {MAX_NESTED} levels",
                kind=LimitError,
            )

    def _check_key(self, name: _Token, *, compared: bool, words: Vocabulary) -> None:
        key = words.keys.get(name)
        if key is None:
            raise unknown_key(self._scope.source, name, words)
        if key.flag and compared:
            raise self._scope.source.error_at(
                name,
                f"{name} is a flag and can't be compared with a number",
                expected=f"`when {name}` or `when not {name}`",
            )
        if not key.flag and not compared:
            raise self._scope.source.error_at(
                name,
                f"{name} is {key.kind} and must be compared with one",
                expected=f"`when {key.example(name)}`, with one of {' '.join(key.operators)}",
            )


def _first_word(tree: _Tree) -> _Token:
    while hasattr(tree, "children"):
        tree = tree.children[0]
    return tree
