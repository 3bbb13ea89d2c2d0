"""Conditions of other tools: scripts of BehaviorTree.CPP such as `level < 25 && !found`."""

from __future__ import annotations

import re
from typing import Final, NoReturn

from islandgp.bt.core.condition import Condition, ConditionExpr, combine, negate
from islandgp.bt.core.node_builder import MAX_NESTED, MAX_TERMS
from islandgp.bt.core.scope import MAX_NUMBER
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import Key, Vocabulary

_WORD: Final = re.compile(
    r"\s*(&&|\|\||!(?!=)|\(|\)|(?P<key>[A-Za-z_]\w*)"
    r"(?:\s*(?P<operator><=|>=|==|!=|<|>)\s*(?P<right>-?[0-9]+(?:\.[0-9]+)?(?![\w.])|'\w*'|[A-Za-z_]\w*))?)"
)


def read_condition(code: str, vocabulary: Vocabulary) -> ConditionExpr:
    """The condition of a script.

    Raises:
        ValueError: the script has no equivalent condition; the message has the reason.
    """
    return _Script(code, vocabulary).read()


class _Script:
    """Reads a script from left to right; && and || have equal precedence, and ! a higher one."""

    def __init__(self, code: str, vocabulary: Vocabulary) -> None:
        self._code, self._vocabulary = code, vocabulary
        self._at = self._terms = 0

    def read(self) -> ConditionExpr:
        condition = self._joined(1)
        if self._code[self._at :].strip():
            self._fail()
        return condition

    def _joined(self, level: int) -> ConditionExpr:
        condition = self._term(level)
        while (operator := self._peek()) in ("&&", "||"):
            self._take()
            condition = combine({"&&": "and", "||": "or"}[operator], [condition, self._term(level)])
        return condition

    def _term(self, level: int) -> ConditionExpr:
        if level > MAX_NESTED or self._terms >= MAX_TERMS:
            raise ValueError(
                f"expected a condition of at most {MAX_TERMS} comparisons and flags,"
                f" {MAX_NESTED} levels"
            )
        match = self._take()
        if match is None or match[1] in ("&&", "||", ")"):
            self._fail()
        if match[1] == "!":
            # It has a higher precedence than a comparison, so a flag or brackets follow.
            following = _WORD.match(self._code, self._at)
            if following is None or following["operator"]:
                self._fail()
            return negate(self._term(level + 1))
        if match[1] == "(":
            condition = self._joined(level + 1)
            if self._peek() != ")":
                self._fail()
            self._take()
            return condition
        self._terms += 1
        return self._single(match["key"], match["operator"] or "==", match["right"] or "true")

    def _peek(self) -> str:
        match = _WORD.match(self._code, self._at)
        return match[1] if match else ""

    def _take(self) -> re.Match[str] | None:
        match = _WORD.match(self._code, self._at)
        self._at = match.end() if match else self._at
        return match

    def _single(self, name: str, operator: str, right: str) -> Condition:
        key, value = _known(name, self._vocabulary), right.strip("'")
        wrong = ValueError(f"{name} is {key.kind}, found {shown(self._code.strip())}")
        if not key.flag:
            if operator not in key.operators:
                raise wrong
            if value in key.words:
                return Condition(name, operator, key.number_of(value))
            if right in self._vocabulary.comparable(name):
                return Condition(name, operator, 0.0, right)
            if key.words or not re.match("-?[0-9]", right):
                raise wrong
            return Condition(name, operator, _number(right))
        if operator not in ("==", "!=") or right not in ("true", "false", "1", "0"):
            raise wrong
        is_true = (right in ("true", "1")) == (operator == "==")
        return Condition(name, "is" if is_true else "not", 0.0)

    def _fail(self) -> NoReturn:
        raise ValueError(
            f"expected a condition such as level < 25 && !found, found {shown(self._code)}"
        )


def _known(key: str, vocabulary: Vocabulary) -> Key:
    keys = vocabulary.keys
    if key not in keys:
        guess = closest(key, keys)
        hint = f"did you mean {guess}?" if guess else f"known keys: {', '.join(keys)}"
        raise ValueError(f"unknown blackboard key {shown(key)}; {hint}")
    return keys[key]


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) <= MAX_NUMBER:
        raise ValueError(
            f"expected a number from {-MAX_NUMBER} to {MAX_NUMBER}, found {shown(text)}"
        )
    return value
