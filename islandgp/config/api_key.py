"""Moves an API key from the command line or a configuration file into the environment.

This is done before Hydra starts, as Hydra prints overrides and writes a sweep's whole configuration
into a file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from islandgp.errors import ConfigError
from islandgp.redaction import FREE, names_secret

VARIABLE: Final = "ANTHROPIC_API_KEY"
CHAT_VARIABLE: Final = "OPENAI_API_KEY"  # of `interface=chat`
KEY: Final = "supervisor.policy.api_key"
NONE: Final = f"{KEY}=null"
SECRET_FIELD: Final = re.compile(
    r"""[{,:'"]\s*(?:[^\s:{},'"]*[_.])?(api_?key|token|secret|password)['"]?\s*:""", re.IGNORECASE
)
"""A secret's name inside an override's value, as in `{api_key: ...}`, quoted or not."""


def without_key(argv: Sequence[str]) -> list[str]:
    """The arguments of a command without an API key, which is moved to the environment.

    Raises:
        ConfigError: an argument has a secret inside its value, where it would not be hidden.
    """
    arguments = []
    for word in argv:
        _check_inside(word)
        name, equals, value = word.partition("=")
        if equals and name.strip(" +~") == KEY:
            _move(value.strip(" '\""))
            arguments.append(NONE)
        else:
            arguments.append(word)
    return arguments


def key_in(configs: Iterable[Mapping[str, Any]]) -> bool:
    """Moves a key in composed configurations to the environment; returns True if there was one.

    Raises:
        ConfigError: two configurations hold different keys.
    """
    policies = (config["supervisor"].get("policy") or {} for config in configs)
    keys = {str(policy["api_key"]) for policy in policies if policy.get("api_key") is not None}
    if len(keys) > 1:
        raise ConfigError(f"{KEY}: expected one key for all jobs, found {len(keys)}; {_REMEDY}.")
    for key in keys:
        _move(key)
    return bool(keys)


_REMEDY: Final = f"set {VARIABLE} in the environment instead"


def _check_free(name: str, value: str) -> None:
    """Raises ConfigError for a secret in `extra_body`, as Hydra prints and stores overrides."""
    inside = not FREE.isdisjoint(re.split(r"[.{,:'\"\s]+", value))
    if not inside and FREE.isdisjoint(name.split(".")):
        return
    keys = re.findall(r"([\w-]+)['\"]?\s*:", value)
    path = name.split(".")
    at = next((i for i, part in enumerate(path) if part in FREE), len(path))
    if secret := next((key for key in [*path[at + 1 :], *keys] if names_secret(key)), None):
        raise ConfigError(
            f"{name.lstrip('+~')}: expected no secret on the command line, found {secret}; write it"
            " into a configuration file, at supervisor.policy.extra_body, and name its folder by"
            " --config-dir"
        )


def _check_inside(word: str) -> None:
    name, _, value = word.partition("=")
    _check_free(name.strip(), value)
    if match := SECRET_FIELD.search(value):
        raise ConfigError(
            f"{name.lstrip('+~')}: expected no secret inside a value, found {match[1]};"
            f" {_REMEDY}, or set it separately, as {KEY}=..."
        )


def _move(key: str) -> None:
    if "," in key or "(" in key:
        raise ConfigError(f"{KEY}: expected one key, found a sweep over several; {_REMEDY}.")
    if key and key != "null":
        os.environ[VARIABLE] = os.environ[CHAT_VARIABLE] = key
