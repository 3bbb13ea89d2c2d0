"""Conditions in the scripts of BehaviorTree.CPP: `level < 25`, `!found`."""

from __future__ import annotations

import re
from typing import Final

from islandgp.bt.source import closest
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

_COMPARISON: Final = re.compile(r"\s*(\w+)\s*(<=|>=|==|!=|<|>)\s*(true|false|-?\d+(?:\.\d+)?)\s*")
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
        raise ValueError(f"expected a condition such as level < 25 or !found, found {code!r}")
    keys = vocabulary.keys
    if key not in keys:
        guess = closest(key, keys)
        hint = f"did you mean {guess}?" if guess else f"there are {', '.join(keys)}"
        raise ValueError(f"unknown blackboard key {key!r}; {hint}")
    if not keys[key].flag:
        if number in ("true", "false"):
            raise ValueError(f"{key} is a number, found {code.strip()!r}")
        return key, operator, float(number)
    if operator not in ("==", "!=") or number not in ("true", "false", "1", "0"):
        raise ValueError(f"{key} is yes or no, found {code.strip()!r}")
    yes = (number in ("true", "1")) == (operator == "==")
    return key, "is" if yes else "not", 0.0
