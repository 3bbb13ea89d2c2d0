"""Builds conditions from parse trees; checks their keys, operators and sizes."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

from islandgp.bt.core.condition import Condition, ConditionExpr, combine, negate
from islandgp.bt.core.scope import Scope, ScopedWord
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import Key, Vocabulary
from islandgp.errors import LimitError

MAX_TERMS: Final = 16  # most comparisons and flags of a condition
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
        self._terms = 0

    def expression(self, tree: _Tree, level: int) -> ConditionExpr:
        """A condition or a part of one; `level`: of brackets and operators, from 1."""
        form, parts = str(tree.data), tree.children
        if form in ("comparison", "flag"):
            self._terms += 1
            self._bounded(parts[0], level)
            name, compared = self._scope.word(parts[0]), parts[1:]
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
