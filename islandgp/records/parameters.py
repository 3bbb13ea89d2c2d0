"""Configuration keys that are secret, and keys that do not change a run's records."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from islandgp.plain import flatten

HIDDEN: Final = "***"  # replaces a secret
RUNTIME_KEYS: Final = frozenset(
    {"evaluator", "tracking", "runs", "resume", "keep_going", "progress"}
)
"""Top-level keys that do not change a run's records, except for a user's evaluator class."""

TASK: Final = frozenset({"domain", "world", "rewards", "curriculum", "classes"})
"""Groups that define fitness and tiers; points of runs that differ in them are not comparable."""

SECRET: Final = re.compile(r"(^|_)(api_?key|token|secret|password)$", re.IGNORECASE)
CREDENTIALS: Final = re.compile(r"(?<=://)[^/\s'\"]*@")
"""User name and password in an address, with the `@` after them."""


def redacted(config: Mapping[str, Any]) -> dict[str, Any]:
    """The configuration with the values of secrets and passwords in addresses hidden."""
    return {str(key): _hidden(str(key), value) for key, value in config.items()}


def identity_config(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a configuration that determines a run's records."""
    without = runtime_keys(config)
    return {key: value for key, value in config.items() if key not in without}


def runtime_keys(*configs: Mapping[str, Any]) -> frozenset[str]:
    """The keys of RUNTIME_KEYS that do not change the records of any of these configurations.

    All evaluators of this package have the same outcomes; those of other packages need not.
    """
    only_built_in = all(_factory(config, "evaluator").startswith("islandgp.") for config in configs)
    return RUNTIME_KEYS if only_built_in else RUNTIME_KEYS - {"evaluator"}


def _factory(config: Mapping[str, Any], key: str) -> str:
    """The path of a component's class in a configuration; "islandgp." without one."""
    part = config.get(key)
    return str(part["factory"]) if isinstance(part, Mapping) and "factory" in part else "islandgp."


def _hidden(key: str, value: Any) -> Any:
    if isinstance(value, Mapping):
        return redacted(value)
    if value and SECRET.search(key):
        return HIDDEN
    if isinstance(value, list | tuple):
        return [_hidden(key, item) for item in value]
    return without_credentials(value) if isinstance(value, str) else value


def without_credentials(text: str) -> str:
    """The text with the user's name and password hidden in every address: `http://***@server`."""
    return CREDENTIALS.sub(f"{HIDDEN}@", text)


def key_of(override: str) -> str:
    """The key of an override, e.g. `gp.population` of `+gp.population=8`."""
    return override.lstrip("+~").partition("=")[0].partition("@")[0]


def short_key(key: str, others: Iterable[str]) -> str:
    """The last two parts of a dotted key, or more if one of `others` ends with the same parts."""
    parts = key.split(".")
    for n in range(2, len(parts)):
        end = ".".join(parts[-n:])
        if not any(f".{other}".endswith(f".{end}") for other in others if other != key):
            return end
    return key


def secret_in(override: str) -> str:
    """The name of a secret that an override sets, also inside its value; "" without one."""
    key, _, value = override.partition("=")
    names = [key_of(key), *re.findall(r"[{,]\s*['\"]?([\w.-]+)['\"]?\s*:", value)]
    return next((name for name in names if SECRET.search(name.rpartition(".")[2])), "")


def flat(config: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The configuration as dotted keys and values as text."""
    for key, value in flatten(config).items():
        yield key, value if isinstance(value, str) else json.dumps(value)


def ending_in_digest(text: str, digested: str, longest: int) -> str:
    """`text`, cut to leave room, and 8 hexadecimal digits of the digest of `digested`.

    The result has `longest` characters at most.
    """
    digest = hashlib.sha256(digested.encode()).hexdigest()[:8]
    return f"{text[: longest - 9]}-{digest}"
