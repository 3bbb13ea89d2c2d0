"""Conditions of other tools: scripts of BehaviorTree.CPP such as `level < 25`, `!found`."""

from __future__ import annotations

import re
from typing import Final

from islandgp.bt.builder import MAX_NUMBER
from islandgp.bt.node import FLAG_OPERATORS, OPERATORS
from islandgp.bt.source import closest, shown
from islandgp.bt.vocabulary import Vocabulary

OPPOSITE: Final = {
    "<": ">=",
    ">=": "<",
    ">": "<=",
    "<=": ">",
    "==": "!=",
    "!=": "==",
    "is": "not",
    "not": "is",
}
"""The operator that holds where another one does not."""

_COMPARISON: Final = re.compile(
    r"\s*(\w+)\s*(<=|>=|==|!=|<|>)\s*(true|false|-?[0-9]+(?:\.[0-9]+)?)\s*"
)
_NUMBER: Final = re.compile(r"-?[0-9]+(?:\.[0-9]+)?")
_FLAG: Final = re.compile(r"\s*(!?)\s*(\w+)\s*")


def read_condition(code: str, vocabulary: Vocabulary) -> tuple[str, str, float]:
    """(key, operator, number) of a `when`, from one condition of a script.

    Raises:
        ValueError: it is not one that a `when` can ask; the message tells why.
    """
    if match := _COMPARISON.fullmatch(code):
        key, operator, number = match.groups()
    elif match := _FLAG.fullmatch(code):
        key, operator, number = match[2], "==", "false" if match[1] else "true"
    else:
        raise ValueError(f"expected a condition such as level < 25 or !found, found {shown(code)}")
    flag = _is_flag(key, vocabulary)
    if not flag:
        if number in ("true", "false"):
            raise ValueError(f"{key} is a number, found {shown(code.strip())}")
        return key, operator, _number(number)
    if operator not in ("==", "!=") or number not in ("true", "false", "1", "0"):
        raise ValueError(f"{key} is yes or no, found {shown(code.strip())}")
    yes = (number in ("true", "1")) == (operator == "==")
    return key, "is" if yes else "not", 0.0


def condition_of(
    key: str, operator: str, number: str, vocabulary: Vocabulary
) -> tuple[str, str, float]:
    """(key, operator, number) of a `when`, from three attributes.

    Raises:
        ValueError: it is not one that a `when` can ask; the message tells why.
    """
    allowed = FLAG_OPERATORS if _is_flag(key, vocabulary) else OPERATORS
    if operator not in allowed:
        raise ValueError(f"expected op {' '.join(allowed)} of {key}, found {shown(operator)}")
    if not _NUMBER.fullmatch(number):
        raise ValueError(f"expected a plain number such as 25 or 12.5, found {shown(number)}")
    if allowed is FLAG_OPERATORS and float(number) != 0:
        raise ValueError(f"{key} is yes or no: expected no number, found {shown(number)}")
    return key, operator, _number(number)


def _is_flag(key: str, vocabulary: Vocabulary) -> bool:
    keys = vocabulary.keys
    if key not in keys:
        guess = closest(key, keys)
        hint = f"did you mean {guess}?" if guess else f"there are {', '.join(keys)}"
        raise ValueError(f"unknown blackboard key {shown(key)}; {hint}")
    return keys[key].flag


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) <= MAX_NUMBER:
        raise ValueError(
            f"expected a number from {-MAX_NUMBER} to {MAX_NUMBER}, found {shown(text)}"
        )
    return value
