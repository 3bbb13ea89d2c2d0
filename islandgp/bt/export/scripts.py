"""Scripts of BehaviorTree.CPP such as `level < 25 && !found` or `tries := tries + 1`.

A script is read with Python's parser, whose `~`, arithmetic and comparisons have the precedence of
the library's, and the parser of the language checks the words of what it says.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from typing import Any, Final, TypeVar

from islandgp.bt.core.arithmetic import Operation, Term, negative, number_text, side
from islandgp.bt.core.condition import (
    OPPOSITE,
    Condition,
    ConditionExpr,
    combine,
    comparison,
    negate,
)
from islandgp.bt.core.language import parse, parse_condition
from islandgp.bt.core.node import SetArgs
from islandgp.bt.core.printer import condition_text
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError

T = TypeVar("T")

NOT_A_NUMBER: Final = ("<", "<=", ">", ">=")
"""Operators by which 0 / 0 compares with any number in the library, and with none in trees."""
_ASSIGNMENT: Final = re.compile(r"\s*([A-Za-z_]\w*)\s*(:=|[-+*/]?=)(?!=)(.*)", re.DOTALL)
_PLACE: Final = re.compile(r"^.*?:\d+:\d+: ")
_WORD: Final = re.compile(r"'\w+'|[A-Za-z_]\w*|&&|\|\||!(?!=)")
_OR: Final = "OR"  # a name of Python only: those of a script get an underscore in front
_PYTHON: Final = {"&&": " and ", "||": f" and {_OR} and ", "!": "~"}
"""In the library && and || have equal precedence, so both become `and`."""
_SIGNS: Final = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_OPERATORS: Final = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip


def read_condition(code: str, vocabulary: Vocabulary) -> ConditionExpr:
    """The condition of a script.

    Raises:
        ValueError: the script has no equivalent condition; the message has the reason.
    """
    expr = _condition(_python(code), vocabulary)
    return _with_numbers(
        read_script(lambda: parse_condition(condition_text(expr), vocabulary), code)
    )


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
        term = _term(_python(right))
        truth = _truth(name, term, vocabulary)
        value = number_text(term) if isinstance(term, float) else side(term)
        text = f"set {name} = {value if truth is None else ('no', 'yes')[truth]}"
        args = read_script(lambda text=text: parse(text, vocabulary), statement).args  # type: ignore[misc]
        assert isinstance(args, SetArgs)
        assigned.append(args.assigned)
    if not assigned:
        raise ValueError("expected key := value, found an empty script")
    return assigned


def read_script(read: Callable[[], T], code: str) -> T:
    """What is read from a translated script. Raises ValueError with the message in a line."""
    try:
        return read()
    except TreeError as error:
        first, _, _, *hints = str(error).splitlines()  # without the line and its caret
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


def _python(code: str) -> ast.expr:
    """The syntax tree of a script as Python, with an underscore in front of each name."""

    def translated(match: re.Match[str]) -> str:
        word = match[0]
        return _PYTHON.get(word) or (word if word[0] == "'" else f"_{word}")

    try:
        return ast.parse(f"({_WORD.sub(translated, code)})", mode="eval").body
    except (SyntaxError, RecursionError, MemoryError):
        raise _not_read(code) from None


def _not_read(code: str) -> ValueError:
    return ValueError(f"expected a condition such as level < 25 && !found, found {shown(code)}")


def _condition(node: ast.expr, vocabulary: Vocabulary) -> ConditionExpr:
    match node:
        case ast.BoolOp(_, [first, *others]):
            expr, word = _condition(first, vocabulary), "and"
            for each in others:
                if isinstance(each, ast.Name) and each.id == _OR:
                    word = "or"
                else:
                    expr, word = combine(word, (expr, _condition(each, vocabulary))), "and"
            return expr
        case ast.UnaryOp(ast.Invert(), operand):
            return negate(_condition(operand, vocabulary))
        case ast.Compare(left, [sign], [right]) if operator := _OPERATORS.get(type(sign), ""):
            key, value = _term(left), _term(right)
            if (truth := _truth(key, value, vocabulary)) is None:
                return comparison(key, operator, value)
            return Condition(str(key), "is" if truth == (operator == "==") else "not", 0.0)
        case _:
            return Condition(side(_term(node)), "is", 0.0)


def _term(node: ast.expr) -> Any:
    match node:
        case ast.Name(name):
            return name[1:]
        case ast.Constant(str(word)):
            return word
        case ast.Constant(int(number) | float(number)):
            return float(min(number, 1e300))
        case ast.UnaryOp(ast.USub(), operand):
            return negative(_term(operand))
        case ast.BinOp(left, sign, right) if type(sign) in _SIGNS:
            return Operation(_SIGNS[type(sign)], (_term(left), _term(right)))
    raise _not_read(re.sub(r"\b_", "", ast.unparse(node)))


def _truth(key: Term, value: Term, vocabulary: Vocabulary) -> bool | None:
    """The value of a flag: true, false, or 1 or 0 beside a key that is one; else None."""
    is_flag = key in vocabulary.keys and vocabulary.keys[str(key)].flag
    flags: dict[Term, bool] = {"true": True, "false": False}
    if is_flag:
        flags |= {1.0: True, 0.0: False}
    return flags.get(value)
