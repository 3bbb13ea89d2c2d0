"""Checks of what a stepped simulator returns, with messages that name its source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from inspect import isgenerator, signature
from math import inf
from typing import Any

from islandgp.bt.core.vocabulary import Key
from islandgp.domain.contract import Schema
from islandgp.errors import DomainError
from islandgp.leaves import is_flag, is_number
from islandgp.plugin import defined_in, short_repr


def fault_of(source: object, expected: str, found: str, remedy: str = "") -> DomainError:
    """The error of a class or function of the user's, with its place in the source."""
    remedy = f"; {remedy}" if remedy else ""
    return DomainError(f"Expected {expected}, found {found}{remedy}{defined_in(source)}.")


def must_last(kind: type, world: Any, step_s: Any) -> None:
    """Raises DomainError unless `step_s` and the setting `ticks` are positive and finite."""
    if not (is_number(step_s) and step_s > 0):
        expected = f"a number of seconds above 0 as {kind.__name__}.step_s"
        raise fault_of(kind, expected, repr(step_s))
    ticks: Any = getattr(world, "ticks", None)
    if not (is_number(ticks) and ticks >= 1):
        expected = f"the setting ticks of {type(world).__name__} to be a number of at least 1"
        remedy = "declare it as `ticks: int = Field(ge=1)`"
        raise fault_of(type(world), expected, repr(ticks), remedy)


def must_take(
    function: Any, arguments: int, error: TypeError, expected: str, names: Iterable[str] = ()
) -> None:
    """Raises DomainError if a TypeError is due to the function's signature."""
    try:
        signature(function).bind(*(None,) * arguments, **dict.fromkeys(names))
    except TypeError as why:
        raise DomainError(f"Expected {expected}, found: {why}{defined_in(function)}.") from error
    except ValueError:  # it has no signature
        return


def near_hint(name: object, names: Iterable[str]) -> str:
    """The closest known name as a hint for a message, or ""."""
    near = get_close_matches(str(name), [*names], 1, 0.6)
    return f"; perhaps {near[0]} is meant" if near else ""


def range_of(key: Key) -> tuple[float, float]:
    """The least and the greatest value of a key."""
    return key.low, 1 if key.flag else inf if key.most is None else key.most


def must_be_values(keys: Mapping[str, Key], values: Any, sense: object) -> None:
    """Checks the values returned by `sense`.

    Args:
        keys: of the vocabulary, by name.
        values: as returned.
        sense: the function, whose place in the source is named in the message.

    Raises:
        DomainError: the values are not a mapping with a number in its range for each key and no
            others.
    """
    if not isinstance(values, Mapping):
        raise fault_of(sense, "a dict of values by key from `sense`", short_repr(values))
    for name, key in keys.items():
        if name not in values:
            raise fault_of(sense, f"a value of the key {name} from `sense`", "none")
        low, high = range_of(key)
        value = values[name]
        if not (is_flag(value) or (is_number(value) and low <= value <= high)):
            most = "" if key.most is None else f" and at most {key.most:g}"
            expected = "True or False" if key.flag else f"a number of at least {key.low:g}{most}"
            expected = f"{key.kind if key.words else expected} as the value of the key {name}"
            raise fault_of(sense, f"{expected} from `sense`", short_repr(value))
    for name in values:
        if name not in keys:
            remedy = "declare it among the keys, or leave it out"
            found = f"{name!r} as well{near_hint(name, keys)}"
            raise fault_of(sense, "values of the vocabulary's keys from `sense`", found, remedy)


def no_ending(result: object, step: object) -> DomainError:
    """The error of a result of `step` that is not a text."""
    expected = 'why the episode is over from `step`, a text, or "" to continue'
    remedy = "leave `yield` out of it" if isgenerator(result) else ""
    return fault_of(step, expected, short_repr(result), remedy)


def must_be_counters(schema: Schema, measured: Any, measures: object) -> None:
    """Raises DomainError unless `measures` returns numbers for the counters that are no events."""
    if not isinstance(measured, Mapping):
        raise fault_of(
            measures, "a dict of values by counter from `measures`", short_repr(measured)
        )
    for name, value in measured.items():
        if name not in schema.counters:
            found = f"{name!r}{near_hint(name, schema.counters)}"
            remedy = "declare it among the counters, or leave it out"
            raise fault_of(measures, "counters of the schema from `measures`", found, remedy)
        if not is_number(value) and not is_flag(value):
            expected = f"a finite number as the counter {name} from `measures`"
            raise fault_of(measures, expected, short_repr(value))
    for name in schema.counters:
        if name not in measured and name not in schema.events:
            expected = f"the counter {name} from `measures`, as it is no event"
            raise fault_of(measures, expected, "none")
