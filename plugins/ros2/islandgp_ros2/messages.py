"""Messages of ROS 2: their classes by name, filled from a map and read by fields."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from typing import Any

from pydantic import TypeAdapter

from islandgp.bt.core.source import closest
from islandgp.errors import ConfigError


def interface(name: str) -> Any:
    """The class of an interface, e.g. of "std_srvs/srv/Trigger". Raises ConfigError."""
    package, kind, word = name.split("/")
    try:
        interface_class = getattr(import_module(f"{package}.{kind}"), word)
        interface_class.__class__.__import_type_support__()
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"Expected the interface {name}, found it not installed ({error}); install the"
            f" package {package} (pip install ros-{package.replace('_', '-')}), or source the"
            " workspace that has it"
        ) from None
    return interface_class


def filled(message: Any, values: Mapping[str, Any], place: str) -> Any:
    """Set fields of a message, and return it.

    Args:
        message: an instance of an interface's class.
        values: by field, or by path such as `pose.position.x`; a mapping for a field that is
            itself a message.
        place: where the values are written, for messages of errors.

    Raises:
        ConfigError: a field does not exist, or has another type.
    """
    with suppress(AttributeError):  # newer versions check types only where they are asked to
        message._check_fields = True
    for path, value in values.items():
        name, _, rest = str(path).partition(".")
        inner = {rest: value} if rest else value
        before = _field(message, name, place)
        if isinstance(inner, Mapping) and hasattr(before, "get_fields_and_field_types"):
            filled(before, inner, f"{place}.{name}")
            continue
        try:
            setattr(message, name, _converted(inner, before))
        except (AssertionError, TypeError, ValueError, OverflowError):
            kind = message.get_fields_and_field_types()[name]
            hint = ", the name of no argument and no key" if isinstance(value, str) else ""
            raise ConfigError(
                f"{place}.{name}: expected a value of {kind}, found {str(inner)[:60]!r}{hint}"
            ) from None
    return message


def _converted(value: Any, default: Any) -> Any:
    """A value of a map or a tree, converted to the type of a field's default.

    A tree without a vocabulary has `5` for a number and `yes` for a flag.

    Raises:
        ValueError: it cannot be converted, as a flag for a number.
    """
    if not isinstance(default, int | float):
        return value
    if isinstance(value, bool) > isinstance(default, bool):
        raise ValueError("a flag for a number")
    return TypeAdapter(type(default)).validate_python(value)


def value_of(message: Any, field: str, place: str = "") -> Any:
    """The value of a field such as `pose.position.x` or `ranges[0]`; "" is the whole message.

    None for an element beyond the end of a list. Raises ConfigError if there is no such field;
    `place`: where it is written.
    """
    for name, index in re.findall(r"([a-z][a-z0-9_]*)(?:\[(\d+)\])?", field):
        message = _field(message, name, place)
        if index:
            message = next(iter(message[int(index) : int(index) + 1]), None)
        if message is None:
            break
    return message


def _field(message: Any, name: str, place: str) -> Any:
    """The value of one field. Raises ConfigError."""
    fields: dict[str, str] = getattr(message, "get_fields_and_field_types", dict)()
    if name not in fields:
        near = closest(name, fields)
        hint = f"; perhaps {near} is meant" if near else ""
        raise ConfigError(
            f"{place}: expected fields among {', '.join(fields) or 'none'}, found {name!r}{hint}"
        )
    return getattr(message, name)
