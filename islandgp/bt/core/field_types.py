"""Check the fields of a declaration against their annotations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from math import isfinite
from numbers import Real
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from islandgp.errors import DomainError


def check_fields(entry: object, where: str) -> None:
    """Check the types of a dataclass's fields, and that its numbers are finite.

    Args:
        entry: an instance of a dataclass.
        where: its name in messages.

    Raises:
        DomainError: a field has a value of another type than its annotation.
    """
    kind: Any = type(entry)
    for name in (each.name for each in fields(kind)):
        value, hint = getattr(entry, name), _hints(kind)[name]
        if not _fits(value, hint):
            raise DomainError(
                f"Expected {_expected(hint)} as {name} of {where}, found {value!r:.60}."
            )


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _expected(hint: Any) -> str:
    """An annotation in words."""
    if get_origin(hint) is UnionType:
        return " or ".join(map(_expected, get_args(hint)))
    names = {float: "a finite number", str: "a text", bool: "True or False", type(None): "None"}
    return names.get(hint) or str(hint).replace("collections.abc.", "").replace(", ...", "")


def _fits(value: object, hint: Any) -> bool:
    """True if a value has the annotated type; a number must be finite."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is UnionType:
        return any(_fits(value, item) for item in parts)
    if origin is Literal:
        return value in parts
    if origin is tuple:
        return isinstance(value, tuple) and all(_fits(item, parts[0]) for item in value)
    if origin is frozenset:
        return isinstance(value, frozenset) and all(_fits(item, parts[0]) for item in value)
    if origin is Mapping:
        return isinstance(value, Mapping)
    if hint is float:
        return isinstance(value, Real) and _is_finite(value)
    return isinstance(value, hint)


def _is_finite(value: Real) -> bool:
    try:
        return isfinite(value)
    except OverflowError:
        return False
