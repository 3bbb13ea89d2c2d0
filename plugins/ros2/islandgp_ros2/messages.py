"""Messages of ROS 2: their classes by name, filled from a map and read by fields."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from typing import Any

from islandgp.bt.core.parameters import NO_YES
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
    fields = message.get_fields_and_field_types()
    with suppress(AttributeError):  # newer versions check types only where they are asked to
        message._check_fields = True
    for path, value in values.items():
        name, _, rest = str(path).partition(".")
        if name not in fields:
            near = closest(name, fields)
            hint = f"; perhaps {near} is meant" if near else ""
            raise ConfigError(
                f"{place}: expected fields among {', '.join(fields) or 'none'},"
                f" found {name!r}{hint}"
            )
        inner = {rest: value} if rest else value
        before = getattr(message, name)
        if isinstance(inner, Mapping) and hasattr(before, "get_fields_and_field_types"):
            filled(before, inner, f"{place}.{name}")
            continue
        try:
            setattr(message, name, _converted(inner, before))
        except (AssertionError, TypeError, ValueError, OverflowError):
            hint = ", the name of no argument and no key" if isinstance(value, str) else ""
            raise ConfigError(
                f"{place}.{name}: expected a value of {fields[name]}, found {str(inner)[:60]!r}"
                f"{hint}"
            ) from None
    return message


def _converted(value: Any, default: Any) -> Any:
    """A value of a map or a tree, converted to the type of a field.

    A tree without a vocabulary has `5` for a number and `yes` for a flag.

    Raises:
        TypeError: a flag for a number.
        ValueError: a word for a number.
    """
    if isinstance(default, bool):
        return value == NO_YES[1] if value in NO_YES else value
    if isinstance(value, bool) and isinstance(default, int | float):
        raise TypeError
    if isinstance(value, str) and isinstance(default, int | float):
        value = float(value)  # of a port whose type is not declared
    if isinstance(default, float) and isinstance(value, int):
        return float(value)
    if isinstance(default, int) and isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def must_have(message: Any, field: str, place: str) -> None:
    """Raises ConfigError if a message has no such field; lists may have no elements yet."""
    for name in re.findall(r"[a-z][a-z0-9_]*", re.sub(r"\[.*", "", field)):
        if not hasattr(message, "get_fields_and_field_types") or not hasattr(message, name):
            fields: dict[str, str] = getattr(message, "get_fields_and_field_types", dict)()
            raise ConfigError(
                f"{place}: expected fields among {', '.join(fields) or 'none'}, found {name!r}"
            )
        message = getattr(message, name)


def value_of(message: Any, field: str) -> Any:
    """The value of a field such as `pose.position.x` or `ranges[0]`; None if there is none."""
    for name, index in re.findall(r"([a-z][a-z0-9_]*)(?:\[(\d+)\])?", field):
        message = getattr(message, name, None)
        if index:
            try:
                message = message[int(index)]
            except (IndexError, TypeError):
                return None
    return message
