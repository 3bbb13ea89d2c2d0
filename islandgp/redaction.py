"""Hides secrets in extra fields of requests, whose names are not known in advance."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

HIDDEN: Final = "***"

FREE: Final = frozenset({"extra_body", "extra_headers"})
"""Configuration keys whose values are fields of a server."""

SECRET_WORDS: Final = frozenset(
    {"apikey", "authorization", "bearer", "cookie", "credential", "credentials", "passwd"}
    | {"password", "secret"}
)
SECRET_LAST_WORDS: Final = frozenset({"auth", "key", "token"})
"""Words in the name of a secret field: `x-api-key`, but not `max_tokens`."""


def names_secret(key: str) -> bool:
    """True if a field with this name is a secret."""
    apart = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", key).lower()
    parts = re.findall(r"[a-z0-9]+", apart)
    return bool(parts) and (not SECRET_WORDS.isdisjoint(parts) or parts[-1] in SECRET_LAST_WORDS)


def without_secrets(value: Any) -> Any:
    """JSON values with each secret replaced by HIDDEN, at any depth."""
    if isinstance(value, Mapping):
        return {
            key: HIDDEN if inner and names_secret(str(key)) else without_secrets(inner)
            for key, inner in value.items()
        }
    return [*map(without_secrets, value)] if isinstance(value, list | tuple) else value


def secrets_in(value: Any, secret: bool = False) -> Iterator[str]:
    """The secret texts in JSON values."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from secrets_in(inner, secret or names_secret(str(key)))
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from secrets_in(inner, secret)
    elif secret and isinstance(value, str):
        yield value
