"""An API key that is given as configuration, taken out of sight before anything is written.

It belongs in the environment. Given on the command line or in a configuration
file it is moved there, before Hydra sees it: Hydra prints overrides, and writes
the whole configuration of a sweep into a file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from islandgp.errors import ConfigError
from islandgp.redaction import FREE, names_secret

VARIABLE: Final = "ANTHROPIC_API_KEY"
KEY: Final = "supervisor.policy.api_key"
NONE: Final = f"{KEY}=null"
INSIDE: Final = re.compile(
    r"""[{,:'"]\s*(?:[^\s:{},'"]*[_.])?(api_?key|token|secret|password)['"]?\s*:""", re.IGNORECASE
)
"""A secret's name inside an override's value, as in `{api_key: ...}`, quoted or not."""


def without_key(words: Sequence[str]) -> list[str]:
    """The words of a command, with a key that is among them moved to the environment.

    Raises:
        ConfigError: a word has a secret inside its value, where nothing would hide it.
    """
    kept = []
    for word in words:
        _check_inside(word)
        name, equals, value = word.partition("=")
        if equals and name.strip(" +~") == KEY:
            _move(value.strip(" '\""))
            kept.append(NONE)
        else:
            kept.append(word)
    return kept


def key_in(configs: Iterable[Mapping[str, Any]]) -> bool:
    """Moves a key that composed configurations hold, from a file of the user's; whether one did.

    Raises:
        ConfigError: two configurations hold different keys.
    """
    keys = set()
    for config in configs:
        policy = config["supervisor"].get("policy") or {}
        if (key := policy.get("api_key")) is not None:
            keys.add(str(key))
    if len(keys) > 1:
        raise ConfigError(f"{KEY}: expected one key for all jobs, found {len(keys)}; {_REMEDY}.")
    for key in keys:
        _move(key)
    return bool(keys)


_REMEDY: Final = f"set {VARIABLE} in the environment instead"


def _check_free(name: str, value: str) -> None:
    """Raises ConfigError for a secret among a server's own fields: Hydra shows and keeps words."""
    inside = not FREE.isdisjoint(re.split(r"[.{,:'\"\s]+", value))
    if not inside and FREE.isdisjoint(name.split(".")):
        return
    keys = re.findall(r"([\w-]+)['\"]?\s*:", value)
    path = name.split(".")
    at = next((i for i, part in enumerate(path) if part in FREE), len(path))
    if secret := next((key for key in [*path[at + 1 :], *keys] if names_secret(key)), None):
        raise ConfigError(
            f"{name.lstrip('+~')}: expected no secret on the command line, found {secret}; write it"
            " into a file of your own, below supervisor.policy.extra_body, and name its folder by"
            " --config-dir"
        )


def _check_inside(word: str) -> None:
    name, _, value = word.partition("=")
    _check_free(name.strip(), value)
    if match := INSIDE.search(value):
        raise ConfigError(
            f"{name.lstrip('+~')}: expected no secret inside a value, found {match[1]};"
            f" {_REMEDY}, or set it separately, as {KEY}=..."
        )


def _move(key: str) -> None:
    if "," in key or "(" in key:
        raise ConfigError(f"{KEY}: expected one key, found a sweep over several; {_REMEDY}.")
    if key and key != "null":
        os.environ[VARIABLE] = key
