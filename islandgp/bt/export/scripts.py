"""Conditions and assignments of BehaviorTree.CPP's script language.

A script is translated to the text of a condition or a `set`, whose words the parser checks.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final, TypeVar

from islandgp.bt.core.condition import MIRRORED, OPPOSITE, Condition, ConditionExpr, combine, negate
from islandgp.bt.core.language import parse, parse_condition
from islandgp.bt.core.node import SetArgs
from islandgp.bt.core.source import shown
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.errors import TreeError

T = TypeVar("T")

NOT_A_NUMBER: Final = ("<", "<=", ">", ">=")
"""Operators by which 0 / 0 compares with any number in the library, and with none in trees."""
_ASSIGNMENT: Final = re.compile(r"\s*([A-Za-z_]\w*)\s*(:=|[-+*/]?=)(?!=)(.*)", re.DOTALL)
_PLACE: Final = re.compile(r"^.*?:\d+:\d+: ")
_TOKEN: Final = re.compile(r"'[^']*'|[A-Za-z_]\w*|[0-9.]+|&&|\|\||[<>=!]=|\S")
_STATEMENT: Final = re.compile(r"(?:'[^']*'|[^;'])+")
_QUOTED: Final = re.compile(r"'([^']*)'")
_WORDS: Final = {"&&": "and", "||": "or", "!": "not"}
_OPEN: Final = re.compile(r"^$|\b(and|or|not)$|[-+*/<>=]$")
_FLAG: Final = re.compile(r"([A-Za-z_]\w*) (==|!=) (true|false|[01])(?![\w.]| [-+*/])")
_TURNED: Final = re.compile(r"(^|\(|(?:and|or|not) )([0-9.]+) ([<>=!]=?) ([A-Za-z_]\w*)(?! [-+*/])")


def read_condition(code: str, vocabulary: Vocabulary | None) -> ConditionExpr:
    """The condition of a script. Without a vocabulary, its keys can be any.

    Raises:
        ValueError: the script has no equivalent condition; the message has the reason.
    """

    def flag(match: re.Match[str]) -> str:
        name, sign, value = match.groups()
        if value in "01" and not _is_flag(name, vocabulary):
            return match[0]
        return "not " * ((value in ("true", "1")) != (sign == "==")) + name

    def turned(match: re.Match[str]) -> str:
        before, number, sign, name = match.groups()
        return f"{before}{name} {MIRRORED[sign]} {number}"

    text = quoted(_TURNED.sub(turned, _FLAG.sub(flag, _tokens(code))))
    return _with_numbers(_read(lambda: parse_condition(text, vocabulary), code))


def read_assignments(code: str, vocabulary: Vocabulary | None) -> list[Condition]:
    """The assignments of a script, in order: `tries := tries + 1; mode := 'dock'`.

    Raises:
        ValueError: the script has another statement, or writes a key that trees do not write.
    """
    assigned: list[Condition] = []
    for statement in filter(str.strip, _STATEMENT.findall(code)):
        match = _ASSIGNMENT.fullmatch(statement)
        if match is None:
            raise ValueError(f"expected key := value, found {shown(statement.strip())}")
        name, sign, right = match.groups()
        value = _tokens(right if sign in (":=", "=") else f"{name} {sign[0]} ({right})")
        flags = {"true": "yes", "false": "no"}
        if _is_flag(name, vocabulary):
            flags |= {"1": "yes", "0": "no"}
        text = f"set {name} = {quoted(flags.get(value, value))}"
        args = _read(lambda text=text: parse(text, vocabulary), statement).args  # type: ignore[misc]
        assert isinstance(args, SetArgs)
        assigned.append(args.assigned)
    if not assigned:
        raise ValueError("expected key := value, found an empty script")
    return assigned


def read_when(code: str, vocabulary: Vocabulary | None) -> ConditionExpr:
    """The condition of one of our own nodes, in the tree language. Raises as `read_condition`."""
    return _read(lambda: parse_condition(quoted(code), vocabulary), code)


def _read(read: Callable[[], T], code: str) -> T:
    """What is read from a translated script. Raises ValueError with the message in a line."""
    try:
        return read()
    except TreeError as error:
        first, _, _, *hints = str(error).splitlines()  # without the line and its caret
        message = " ".join([f"{_PLACE.sub('', first)}.", *hints])
        raise ValueError(f"in {shown(code.strip())}: {message}") from None


def quoted(text: str) -> str:
    """A text with words of keys in the quotes of trees."""
    return _QUOTED.sub(r'"\1"', text)


def _is_flag(name: str, vocabulary: Vocabulary | None) -> bool:
    return vocabulary is not None and name in vocabulary.keys and vocabulary.keys[name].flag


def _with_numbers(expr: ConditionExpr) -> ConditionExpr:
    """The condition with 0 / 0 as in the library: a comparison as its negated opposite."""
    if not isinstance(expr, Condition):
        parts = [*map(_with_numbers, expr.parts)]
        return negate(parts[0]) if expr.word == "not" else combine(expr.word, parts)
    if expr.divides and expr.operator in NOT_A_NUMBER:
        return negate(expr._replace(operator=OPPOSITE[expr.operator]))
    return expr


def _tokens(code: str) -> str:
    """The words of a script, with a blank between two; && and || have equal precedence there."""
    levels: list[list[str]] = [[]]
    for token in _TOKEN.findall(code):
        here = levels[-1]
        if here[-2:-1] == ["not"] and token not in ("&&", "||", ")"):
            levels.append([])  # there, ! binds more strongly than a comparison
        if token == "(":
            levels.append([])
        elif token == ")" and len(levels) > 1:
            levels.pop()
            levels[-1].append(f"({' '.join(here)})")
        elif token == "&&" and "or" in here:
            here[:] = [f"({' '.join(here)})", "and"]
        else:
            here.append(_WORDS.get(token, token))
    text = " ".join(levels[0])
    if len(levels) > 1 or _OPEN.search(text) or not {*_QUOTED.sub("", text)}.isdisjoint('{}#"'):
        raise ValueError(f"expected a condition such as level < 25 && !found, found {shown(code)}")
    return text
