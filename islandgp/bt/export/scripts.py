"""Conditions of other tools: scripts of BehaviorTree.CPP such as `level < 25 && !found`."""

from __future__ import annotations

import re
from typing import Final, NoReturn, TypeAlias

from islandgp.bt.core.arithmetic import Named, Operation, Term, bounds, negative, number_text
from islandgp.bt.core.condition import (
    OPERATORS,
    OPPOSITE,
    Compound,
    Condition,
    ConditionExpr,
    combine,
    comparison,
    negate,
)
from islandgp.bt.core.kinds import NAME
from islandgp.bt.core.node_builder import MAX_NESTED, MAX_OPERANDS, MAX_TERMS
from islandgp.bt.core.parameters import NO_YES
from islandgp.bt.core.scope import MAX_NUMBER
from islandgp.bt.core.source import closest, shown
from islandgp.bt.core.vocabulary import Key, Vocabulary

_WORD: Final = re.compile(
    r"\s*(&&|\|\||[<>=!]=|[-+*/()<>!]|[0-9]+(?:\.[0-9]+)?(?![\w.])|'\w*'|[A-Za-z_]\w*)"
)
NOT_A_NUMBER: Final = ("<", "<=", ">", ">=")
"""Operators by which 0 / 0 compares with any number in the library, and with none in trees."""

_PRECEDENCE: Final = {"+": 1, "-": 1, "*": 2, "/": 2}

_Value: TypeAlias = "Term | Condition | Compound"
"""A part of a script: a name may be a key, a flag or a word, and a text keeps its quotes."""


def read_condition(code: str, vocabulary: Vocabulary) -> ConditionExpr:
    """The condition of a script.

    Raises:
        ValueError: the script has no equivalent condition; the message has the reason.
    """
    return _Script(code, vocabulary).read()


_ASSIGNMENT: Final = re.compile(r"\s*([A-Za-z_]\w*)\s*(:=|[-+*/]?=)(?!=)(.*)", re.DOTALL)


def read_assignments(code: str, vocabulary: Vocabulary) -> list[Condition]:
    """The assignments of a script, in order: `tries := tries + 1; mode := 'dock'`.

    Raises:
        ValueError: the script has another statement, or writes a key that trees do not write.
    """
    assigned: list[Condition] = []
    for statement in filter(str.strip, code.split(";")):
        match = _ASSIGNMENT.fullmatch(statement)
        if match is None:
            raise ValueError(f"expected key := value, found {shown(statement.strip())}")
        name, sign, right = match.groups()
        right = right if sign in (":=", "=") else f"{name} {sign[0]} ({right})"
        assigned.append(_Script(right, vocabulary).assigned(name))
    if not assigned:
        raise ValueError("expected key := value, found an empty script")
    return assigned


class _Script:
    """Reads a script from left to right; && and || have equal precedence, and ! a higher one."""

    def __init__(self, code: str, vocabulary: Vocabulary) -> None:
        self._code, self._vocabulary = code, vocabulary
        self._at = self._terms = self._operands = 0

    def read(self) -> ConditionExpr:
        condition = self._condition(self._joined(1))
        if self._code[self._at :].strip():
            self._fail()
        return condition

    def assigned(self, name: str) -> Condition:
        """The assignment of the script's value to a key."""
        key, value = _known(name, self._vocabulary), self._sum(1)
        if self._code[self._at :].strip() or isinstance(value, Condition | Compound):
            raise ValueError(f"expected a value for {name}, found {shown(self._code.strip())}")
        if not key.writable:
            raise ValueError(
                f"{name} is a key that only the domain writes; declare it with initial"
            )
        if not key.flag and not key.words:
            return comparison(name, "=", self._number_or_key(value))
        if isinstance(value, Operation):
            self._fail()
        text = value.strip("'") if isinstance(value, str) else number_text(value)
        words = {"true": "yes", "1": "yes", "false": "no", "0": "no"} if key.flag else {}
        if (word := words.get(text, text)) in (key.words or NO_YES):
            number = key.words.index(word) if key.words else NO_YES.index(word)
            return Condition(name, "=", Named(word, number))
        return Condition(name, "=", 0.0, text)  # a key, as the parser checks

    def _joined(self, level: int) -> _Value:
        value = self._compared(level)
        while (operator := self._peek()) in ("&&", "||"):
            self._take()
            parts = [self._condition(value), self._condition(self._compared(level))]
            value = combine({"&&": "and", "||": "or"}[operator], parts)
        return value

    def _compared(self, level: int) -> _Value:
        left = self._sum(level)
        if (operator := self._peek()) not in OPERATORS:
            return left
        self._take()
        return self._comparison(left, operator, self._sum(level))

    def _sum(self, level: int, least: int = 1) -> _Value:
        """A sum, or a product if `least` is 2."""
        value = self._operand(level)
        while (sign := self._peek()) in _PRECEDENCE and _PRECEDENCE[sign] >= least:
            self._take()
            right = self._number_or_key(self._sum(level, _PRECEDENCE[sign] + 1))
            if sign == "/" and bounds(right, {}) == (0, 0):
                self._fail()
            value = Operation(sign, (self._number_or_key(value), right))
        return value

    def _operand(self, level: int) -> _Value:
        self._operands += 1
        if level > MAX_NESTED or self._terms >= MAX_TERMS or self._operands > MAX_OPERANDS:
            raise ValueError(
                f"expected a condition of at most {MAX_TERMS} comparisons and flags,"
                f" {MAX_OPERANDS} keys and numbers, {MAX_NESTED} levels"
            )
        word = self._take()
        if word == "(":
            value = self._joined(level + 1)
            if self._take() != ")":
                self._fail()
            return value
        # Both have a higher precedence than a comparison, so a flag, a key or brackets follow.
        if word == "!":
            return negate(self._condition(self._operand(level + 1)))
        if word == "-":
            return negative(self._number_or_key(self._operand(level + 1)))
        if word[:1].isdigit():
            return _number(word)
        if not NAME.fullmatch(word.strip("'")):
            self._fail()
        return word

    def _peek(self) -> str:
        match = _WORD.match(self._code, self._at)
        return match[1] if match else ""

    def _take(self) -> str:
        match = _WORD.match(self._code, self._at)
        self._at = match.end() if match else self._at
        return match[1] if match else ""

    def _condition(self, value: _Value) -> ConditionExpr:
        """A value as a condition: a name is a flag."""
        if isinstance(value, Condition | Compound):
            return value
        if not isinstance(value, str):
            self._fail()
        return self._single(value, "==", "true")

    def _number_or_key(self, value: _Value) -> Term:
        """A value as a part of a sum."""
        if isinstance(value, Condition | Compound):
            self._fail()
        if isinstance(value, str):
            key = _known(value, self._vocabulary)
            if key.flag or key.words:
                raise ValueError(f"{value} is {key.kind}, found {shown(self._code.strip())}")
        return value

    def _comparison(self, left: _Value, operator: str, right: _Value) -> ConditionExpr:
        if isinstance(left, Condition | Compound) or isinstance(right, Condition | Compound):
            self._fail()
        if isinstance(left, str) and not isinstance(right, Operation):
            return self._single(left, operator, right)
        compared = comparison(self._number_or_key(left), operator, self._number_or_key(right))
        if not isinstance(left, str | Operation) and not isinstance(right, str | Operation):
            self._fail()
        self._terms += 1
        if compared.divides and operator in NOT_A_NUMBER:
            return negate(compared._replace(operator=OPPOSITE[compared.operator]))
        return compared

    def _single(self, name: str, operator: str, right: float | str) -> Condition:
        self._terms += 1
        key, text = _known(name, self._vocabulary), str(right)
        wrong = ValueError(f"{name} is {key.kind}, found {shown(self._code.strip())}")
        if not key.flag:
            value = text.strip("'")
            if operator not in key.operators:
                raise wrong
            if value in key.words:
                return Condition(name, operator, key.number_of(value))
            if right in self._vocabulary.comparable(name):
                return Condition(name, operator, 0.0, text)
            if key.words or isinstance(right, str):
                raise wrong
            return Condition(name, operator, right)
        if operator not in ("==", "!=") or right not in ("true", "false", 1, 0):
            raise wrong
        is_true = (right in ("true", 1)) == (operator == "==")
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
