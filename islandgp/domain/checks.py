"""Checks of what a stepped simulator returns, with messages that name its source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from inspect import isgenerator, signature
from typing import Any

from islandgp.bt.core.vocabulary import Key
from islandgp.domain.contract import Schema
from islandgp.errors import DomainError
from islandgp.leaves import is_flag, is_number
from islandgp.plugin import defined_in, short_repr


def must_last(kind: type, world: Any, step_s: Any) -> None:
    """Raises DomainError unless `step_s` and the setting `ticks` are positive and finite."""
    if not (is_number(step_s) and step_s > 0):
        raise DomainError(
            f"Expected a number of seconds above 0 as {kind.__name__}.step_s, found"
            f" {step_s!r}{defined_in(kind)}."
        )
    ticks: Any = getattr(world, "ticks", None)
    if not (is_number(ticks) and ticks >= 1):
        raise DomainError(
            f"Expected the setting ticks of {type(world).__name__} to be a number of at least 1,"
            f" found {ticks!r}; declare it as `ticks: int = Field(ge=1)`{defined_in(type(world))}."
        )


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


def must_be_values(keys: Mapping[str, Key], values: Any, sense: object) -> None:
    """Checks the values returned by `sense`.

    Args:
        keys: of the vocabulary, by name.
        values: as returned.
        sense: the function, whose place in the source is named in the message.

    Raises:
        DomainError: the values are not a mapping with a finite number for each key and no others.
    """
    where = defined_in(sense)
    if not isinstance(values, Mapping):
        raise DomainError(
            f"Expected a dict of values by key from `sense`, found {short_repr(values)}{where}."
        )
    for name, key in keys.items():
        if name not in values:
            raise DomainError(
                f"Expected a value of the key {name} from `sense`, found none{where}."
            )
        if not is_number(values[name]) and not is_flag(values[name]):
            most = "" if key.most is None else f" and at most {key.most:g}"
            expected = "True or False" if key.flag else f"a number of at least {key.low:g}{most}"
            expected = key.kind if key.words else expected
            raise DomainError(
                f"Expected {expected} as the value of the key {name} from `sense`, found"
                f" {short_repr(values[name])}{where}."
            )
    for name in values:
        if name not in keys:
            raise DomainError(
                f"Expected values of the vocabulary's keys from `sense`, found {name!r} as well"
                f"{near_hint(name, keys)}; declare it among the keys, or leave it out{where}."
            )


def no_ending(result: object, step: object) -> str:
    """The message for a result of `step` that is not a text."""
    hint = "; leave `yield` out of it" if isgenerator(result) else ""
    return (
        'Expected why the episode is over from `step`, a text, or "" to continue, found'
        f" {short_repr(result)}{hint}{defined_in(step)}."
    )


def wrong_measure(schema: Schema, measured: Any) -> str:
    """The first error in the values from `measures`, or ""."""
    if not isinstance(measured, Mapping):
        return f"Expected a dict of values by counter from `measures`, found {short_repr(measured)}"
    for name, value in measured.items():
        if name not in schema.counters:
            return (
                f"Expected counters of the schema from `measures`, found {name!r}"
                f"{near_hint(name, schema.counters)}; declare it among the counters, or leave"
                " it out"
            )
        if not is_number(value) and not is_flag(value):
            expected = f"Expected a finite number as the counter {name} from `measures`"
            return f"{expected}, found {short_repr(value)}"
    for name in schema.counters:
        if name not in measured and name not in schema.events:
            return f"Expected the counter {name} from `measures`, as it is no event, found none"
    return ""
