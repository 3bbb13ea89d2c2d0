"""Scripts of BehaviorTree.CPP such as `level < 25 && !found` or `tries := tries + 1`.

A script is translated to the language, word by word, and the parser checks it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final, NoReturn, TypeVar

from islandgp.bt.core.condition import (
    OPERATORS,
    OPPOSITE,
    Condition,
    ConditionExpr,
    combine,
    negate,
)
from islandgp.bt.core.language import parse, parse_condition
from islandgp.bt.core.node import SetArgs
from islandgp.bt.core.node_builder import MAX_NESTED
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError

T = TypeVar("T")

_WORD: Final = re.compile(
    r"\s*(&&|\|\||[<>=!]=|[-+*/()<>!]|[0-9]+(?:\.[0-9]+)?(?![\w.])|'\w*'|[A-Za-z_]\w*)"
)
_ASSIGNMENT: Final = re.compile(r"\s*([A-Za-z_]\w*)\s*(:=|[-+*/]?=)(?!=)(.*)", re.DOTALL)
_PLACE: Final = re.compile(r"^.*?:\d+:\d+: ")
_JOINT: Final = {"&&": "and", "||": "or"}
NOT_A_NUMBER: Final = ("<", "<=", ">", ">=")
"""Operators by which 0 / 0 compares with any number in the library, and with none in trees."""


def read_condition(code: str, vocabulary: Vocabulary) -> ConditionExpr:
    """The condition of a script.

    Raises:
        ValueError: the script has no equivalent condition; the message has the reason.
    """
    text = _Script(code, vocabulary).condition()
    return _with_numbers(_read(lambda: parse_condition(text, vocabulary), code))


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
        text = f"set {name} = {_Script(right, vocabulary).value(name)}"
        args = _read(lambda text=text: parse(text, vocabulary), statement).args  # type: ignore[misc]
        assert isinstance(args, SetArgs)
        assigned.append(args.assigned)
    if not assigned:
        raise ValueError("expected key := value, found an empty script")
    return assigned


def _read(read: Callable[[], T], code: str) -> T:
    """What is read from a translated script. Raises ValueError with the message in a line."""
    try:
        return read()
    except TreeError as error:
        first, *rest = str(error).splitlines()
        hints = [f"{line[:1].lower()}{line[1:]}" for line in (rest[2:] if error.source else rest)]
        message = "; ".join([_PLACE.sub("", first), *hints])
        raise ValueError(f"{message}, in {shown(code.strip())}") from None


def _with_numbers(expr: ConditionExpr) -> ConditionExpr:
    """The condition with 0 / 0 as in the library: a comparison as its negated opposite."""
    if not isinstance(expr, Condition):
        parts = [*map(_with_numbers, expr.parts)]
        return negate(parts[0]) if expr.word == "not" else combine(expr.word, parts)
    if expr.divides and expr.operator in NOT_A_NUMBER:
        return negate(expr._replace(operator=OPPOSITE[expr.operator]))
    return expr


class _Script:
    """Translates a script; && and || have equal precedence, and ! a higher one."""

    def __init__(self, code: str, vocabulary: Vocabulary) -> None:
        self._code, self._keys = code, vocabulary.keys
        self._at = self._level = 0

    def condition(self) -> str:
        """The whole script as a condition."""
        text = self._joined()
        if self._code[self._at :].strip():
            self._fail()
        return text

    def value(self, name: str) -> str:
        """The whole script as the value of a key."""
        text = self._sum()
        if self._code[self._at :].strip():
            raise ValueError(f"expected a value for {name}, found {shown(self._code.strip())}")
        is_flag = name in self._keys and self._keys[name].flag
        words = {"true": "yes", "false": "no", **({"1": "yes", "0": "no"} if is_flag else {})}
        return words.get(text, text)

    def _joined(self) -> str:
        text, before = self._compared(), ""
        while joint := _JOINT.get(self._peek()):
            self._take()
            text = f"({text})" if before not in ("", joint) else text
            text, before = f"{text} {joint} {self._compared()}", joint
        return text

    def _compared(self) -> str:
        left = self._sum()
        if (operator := self._peek()) not in OPERATORS:
            return left
        self._take()
        right = self._sum()
        is_flag = left in self._keys and self._keys[left].flag
        if right in ("true", "false") or (is_flag and right in ("0", "1")):
            return f"not {left}" * ((right in ("true", "1")) != (operator == "==")) or left
        return f"{left} {operator} {right}"

    def _sum(self) -> str:
        text = self._operand()
        while self._peek() in ("+", "-", "*", "/"):
            text = f"{text} {self._take()} {self._operand()}"
        return text

    def _operand(self) -> str:
        word = self._take()
        self._level += 1
        if self._level > 4 * MAX_NESTED:
            raise ValueError(f"expected a condition of at most {MAX_NESTED} levels")
        if word == "(":
            word = f"({self._joined()})"
            if self._take() != ")":
                self._fail()
        elif word == "!":  # of a flag or brackets, as it has a higher precedence
            word = f"not {self._operand()}"
            if (following := self._peek()) in OPERATORS or following in ("+", "-", "*", "/"):
                self._fail()
        elif word == "-":
            word = f"-{self._operand()}"
        elif not word.strip("'")[:1].isalnum() and word.strip("'")[:1] != "_":
            self._fail()
        self._level -= 1
        return word.strip("'")

    def _peek(self) -> str:
        match = _WORD.match(self._code, self._at)
        return match[1] if match else ""

    def _take(self) -> str:
        match = _WORD.match(self._code, self._at)
        self._at = match.end() if match else self._at
        return match[1] if match else ""

    def _fail(self) -> NoReturn:
        raise ValueError(
            f"expected a condition such as level < 25 && !found, found {shown(self._code)}"
        )
