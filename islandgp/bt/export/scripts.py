"""Conditions in the scripts of BehaviorTree.CPP: `batteryLevel < 25`, `!foundGarbage`."""

from __future__ import annotations

import re
from typing import Final

from islandgp.bt.node import KEYS
from islandgp.bt.source import closest

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


def read_condition(code: str) -> tuple[str, str, float]:
    """(key, operator, number) of a `when`, from one condition of a script.

    Raises:
        ValueError: it is not one that a `when` can ask; the message tells why.
    """
    if match := _COMPARISON.fullmatch(code):
        key, operator, number = match.groups()
    elif match := _FLAG.fullmatch(code):
        key, operator, number = match[2], "==", "false" if match[1] else "true"
    else:
        raise ValueError(
            f"expected a condition such as batteryLevel < 25 or !foundGarbage, found {code!r}"
        )
    if key not in KEYS:
        guess = closest(key, KEYS)
        hint = f"did you mean {guess}?" if guess else f"there are {', '.join(KEYS)}"
        raise ValueError(f"unknown blackboard key {key!r}; {hint}")
    if not KEYS[key].flag:
        if number in ("true", "false"):
            raise ValueError(f"{key} is a number, found {code.strip()!r}")
        return key, operator, float(number)
    if operator not in ("==", "!=") or number not in ("true", "false", "1", "0"):
        raise ValueError(f"{key} is yes or no, found {code.strip()!r}")
    yes = (number in ("true", "1")) == (operator == "==")
    return key, "is" if yes else "not", 0.0
