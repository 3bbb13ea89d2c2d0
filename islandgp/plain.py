"""Reads JSON into plain values, and validates and converts them to dataclasses."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from typing import Annotated, Any, Final, NoReturn, TypeVar, cast

from pydantic import AfterValidator, BeforeValidator, PlainSerializer, TypeAdapter, ValidationError

from islandgp.gate import cleaned_values

T = TypeVar("T")

DECODE_ERRORS: Final = (
    ValueError,
    KeyError,
    TypeError,
    AttributeError,
    IndexError,
    OverflowError,
    RecursionError,
)
"""Exceptions of reading values with an unexpected form."""

Pair = TypeVar("Pair", bound=tuple[float, float])


def _rising(pair: Pair) -> Pair:
    if pair[0] > pair[1]:
        raise ValueError(f"expected the lower number first, found {list(pair)}")
    return pair


RISING: Final = AfterValidator(_rising)
"""Makes pydantic reject a pair of numbers whose first one is the greater one."""


def read_json(text: str | bytes) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: the text is not JSON, has a number that is NaN, infinite or an integer beyond 64
            bits, or is nested too deeply.
    """
    raw = text if isinstance(text, bytes) else text.encode(errors="replace")
    odd = _ODD_NUMBER.search(raw)
    hooks: dict[str, Any] = {"parse_int": _small, "parse_float": _finite} if odd else {}
    try:
        return json.loads(text, parse_constant=_no_number, **hooks)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


_SIGNS: Final = (b"\\u", b"\\b", b"\\f", b"\\r", b"\x7f", b"\xc2", b"\xe2")
"""One of these is in each JSON text with a control character or half of a surrogate pair."""


def without_controls(text: str | bytes) -> bytes:
    """The JSON text with `?` for each control character in its texts."""
    raw = text.encode(errors="replace") if isinstance(text, str) else text
    if any(sign in raw for sign in _SIGNS):
        with suppress(ValueError, RecursionError):  # reported by the caller
            return json.dumps(cleaned_values(json.loads(raw))).encode()
    return raw


_ODD_NUMBER: Final = re.compile(rb"\d{19}|[eE]\+?\d{3}")
"""In each JSON text with a number that may be too large."""


def _small(text: str) -> int:
    return int(text) if len(text) < 20 and abs(int(text)) < 2**63 else _no_number(text[:30])


def _finite(text: str) -> float:
    return float(text) if math.isfinite(float(text)) else _no_number(text[:30])


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def validate_json(kind: Any, text: str | bytes) -> Any:
    """The plain values of a JSON text, without control characters, validated with a type.

    Additional fields are accepted.

    Raises:
        ValueError: a field is missing or has another type; the message names it.
    """
    raw = without_controls(text)
    _validated(kind, raw)
    return read_json(raw)


def from_json(kind: type[T], value: Any, context: Any = None) -> T:
    """A dataclass, with nested ones, from JSON values.

    Args:
        kind: the dataclass.
        value: the JSON values.
        context: for validators of its fields, as pydantic's `ValidationInfo.context`.

    Raises:
        ValueError: as `validate_json`.
    """
    instance: T = _validated(kind, json.dumps(value).encode(), context)
    return instance


def to_json(value: Any) -> Any:
    """A dataclass, with nested ones, as JSON values."""
    return _adapter(cast("Any", type(value))).dump_python(value, mode="json")


NAME: Final = re.compile(r"[\w. :/-]+")  # names that MLflow takes


def flatten(config: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Nested mappings by dotted keys; lists and mappings with other signs in keys stay whole."""
    by_key: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, Mapping) and value and all(NAME.fullmatch(str(k)) for k in value):
            by_key |= flatten(value, f"{path}{key}.")
        else:
            by_key[f"{path}{key}"] = value
    return by_key


NanAsNull = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: None if math.isnan(value) else value),
]
"""The type of a number that is null in JSON if it is NaN."""


def _validated(kind: Any, text: bytes, context: Any = None) -> Any:
    try:
        return _adapter(kind).validate_json(text, strict=True, context=context)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        at = ".".join(map(str, first["loc"][:8])) or "the whole"
        message = first["msg"]
        raise ValueError(f"{at:.100}: {message[0].lower()}{message[1:]:.100}") from None


def from_plain(kind: type[T], plain: Any) -> T:
    """A dataclass (with nested ones) from plain values that `validate_json` has validated."""
    adapter: TypeAdapter[T] = _adapter(cast("Any", kind))
    return adapter.validate_python(plain)


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
