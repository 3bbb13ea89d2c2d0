"""Checks of what a stepped simulator returns, with messages that name its source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from inspect import isgenerator
from math import inf
from typing import Any

from islandgp.bt.core.vocabulary import Key
from islandgp.errors import DomainError
from islandgp.leaves import is_flag, is_number
from islandgp.plugin import defined_in, short_repr


def fault_of(source: object, expected: str, found: str, remedy: str = "") -> DomainError:
    """The error of a class or function of the user's, with its place in the source."""
    remedy = f"; {remedy}" if remedy else ""
    return DomainError(f"Expected {expected}, found {found}{remedy}{defined_in(source)}.")


def near_hint(name: object, names: Iterable[str]) -> str:
    """The closest known name as a hint for a message, or ""."""
    near = get_close_matches(str(name), [*names], 1, 0.6)
    return f"; perhaps {near[0]} is meant" if near else ""


def must_be_numbers(
    values: Any, kind: str, declared: Mapping[str, Key | None], needed: Iterable[str], source: Any
) -> None:
    """Checks the values returned by a user's function.

    Args:
        values: as returned.
        kind: "key" or "counter".
        declared: the key of each name; None: any number fits.
        needed: names that must have a value.
        source: the function, whose place in the source is named in the message.

    Raises:
        DomainError: the values are not a mapping with a number in its range for each of `needed`,
            and for no others than those declared.
    """
    where = "from `sense`" if kind == "key" else "from `measures`"
    if not isinstance(values, Mapping):
        raise fault_of(source, f"a dict of values by {kind} {where}", short_repr(values))
    for name in (*needed, *values):
        if name not in declared:
            remedy = f"declare it among the {kind}s, or leave it out"
            found = f"{name!r}{near_hint(name, declared)}"
            raise fault_of(source, f"values of declared {kind}s {where}", found, remedy)
        if name not in values:
            raise fault_of(source, f"a value of the {kind} {name} {where}", "none")
        key, value = declared[name], values[name]
        low, high = (-inf, inf) if key is None else key.bounds
        if not (is_flag(value) or (is_number(value) and low <= value <= high)):
            expected = f"{_values_of(key)} as the value of the {kind} {name} {where}"
            raise fault_of(source, expected, short_repr(value))


def _values_of(key: Key | None) -> str:
    """The values that a domain can give a key, in words; None: a counter."""
    if key is None:
        return "a finite number"
    return "True or False" if key.flag else key.kind if key.words else key.values


def no_ending(result: object, step: object) -> DomainError:
    """The error of a result of `step` that is not a text."""
    expected = 'why the episode is over from `step`, a text, or "" to continue'
    remedy = "leave `yield` out of it" if isgenerator(result) else ""
    return fault_of(step, expected, short_repr(result), remedy)
