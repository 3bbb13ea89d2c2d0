"""Errors of pydantic as lines of the form `KEY: expected ..., found ...`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from types import UnionType
from typing import Any, Final, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from islandgp.errors import IslandError
from islandgp.plugin import ComponentConfig, imported
from islandgp.scoring.classes import CLASS_NAME

TAG: Final = r"^[A-Za-z0-9_. :/-]{1,250}$"
"""Names of tags that MLflow takes."""

NAME: Final = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
"""Names of runs and sweeps, which are names of folders."""

PATTERN_TEXTS: Final = {
    TAG: "1 to 250 letters, digits, spaces and . _ : / -",
    NAME: "letters, digits and . _ -, beginning with a letter or a digit",
    CLASS_NAME: "small letters, digits and _, beginning with a letter",
}
"""Descriptions of patterns."""


def setting_at(settings: Any, key: int | str) -> Any:
    """The value at a key of plain configuration, or of settings; None if there is none."""
    if isinstance(settings, ComponentConfig) and key == "policy":
        return settings.settings()
    if isinstance(settings, Mapping):
        return settings.get(key)
    if isinstance(settings, list):
        return settings[key] if isinstance(key, int) else None
    return getattr(settings, str(key), None)


def error_lines(
    error: ValidationError,
    config: Mapping[str, Any],
    model: type[BaseModel],
    *,
    at: tuple[str, ...] = (),
) -> Iterator[str]:
    """A line for each error of validating `config` with `model`; `at` is the path of `config`."""
    details = error.errors()
    inside = {e["loc"][:n] for e in details for n in range(len(e["loc"]))}
    for e in details:
        if e["type"] == "too_short" and e["loc"] in inside:
            continue  # errors within items are reported only once
        if e["loc"][0:1] == ("tags",) and e["loc"][-1] != "[key]":
            name = f"tags.{e['loc'][1]}" if e["loc"][1:] else "tags"
            assignment = f"{name}={e['input']!r}"
            yield f"{assignment}: expected text, a number, true or false; give one of these"
            continue
        path = ".".join(str(part) for part in (*at, *e["loc"]))
        message = e["msg"].removeprefix("Value error, ")
        if e["type"] == "extra_forbidden":
            yield unknown_key(path, keys_at(config, e["loc"][:-1], model))
        elif (pattern_text := PATTERN_TEXTS.get(e.get("ctx", {}).get("pattern", ""))) is not None:
            yield f"{path.removesuffix('.[key]')}: expected {pattern_text}, found {e['input']!r}"
        elif e["type"] == "missing":
            yield f"{path}: expected a value, found none"
        elif e["type"] == "model_type":
            names = ", ".join(keys_at(config, e["loc"], model))
            yield f"{path}: expected a mapping with keys of {names}, found {e['input']!r}"
        elif e["type"] == "value_error":
            colon = "." if re.match(r"[a-z0-9_.]+: ", message) else ": "  # it begins with a key
            yield f"{path}{colon}{message}" if path else message
        else:
            yield f"{path}={e['input']!r}: {message[0].lower()}{message[1:]}"


def keys_at(
    config: Mapping[str, Any], path: Sequence[int | str], model: type[BaseModel]
) -> list[str]:
    """The valid keys at a path: the fields of the model there, else the keys of `config`."""
    kind: Any = model
    section: Any = config
    for part in path:
        kind = _kind_below(kind, part, section)
        section = setting_at(section, part)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return [*kind.model_fields]
    keys = map(str, section) if isinstance(section, Mapping) else ()
    return [key for key in keys if not key.startswith("_")]


def _kind_below(kind: Any, part: int | str, config: Any) -> Any:
    """The type of a key of a type; None if it is unknown."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if part in ("world", "rewards") and "domain" in kind.model_fields:
            return getattr(_factory(setting_at(config, "domain")), str(part).capitalize(), None)
        if issubclass(kind, ComponentConfig) and part == "policy":
            return getattr(_factory(config), "Settings", None)
        field = kind.model_fields.get(str(part))
        kind = field and field.annotation
    else:
        inner = [a for a in get_args(kind) if a is not Ellipsis]
        kind = inner[-1] if inner else None  # of dict[str, kind] or tuple[kind, ...]
    models = [a for a in get_args(kind) if isinstance(a, type) and issubclass(a, BaseModel)]
    union = get_origin(kind) in (Union, UnionType)
    return models[0] if union and models else kind


def _factory(part: Any) -> Any:
    """The class that a group names; None if there is none."""
    try:
        return imported(str(setting_at(part, "factory")))
    except (ValidationError, IslandError):
        return None


def unknown_option(group: str, option: str, options: Sequence[str]) -> str:
    """The line for an option that a group does not have, with the nearest one."""
    near = get_close_matches(option, options, 1, 0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"{group}={option}: unknown option; {hint}there are {', '.join(options)}"


def unknown_key(path: str, keys: list[str]) -> str:
    """The line for an unknown key, with the nearest known key."""
    parent, _, key = path.rpartition(".")
    keys = [other for other in keys if other != key]
    near = get_close_matches(key, keys, 1, 0.5)
    dot = f"{parent}." if parent else ""
    known_keys = f"there are {', '.join(sorted(keys))}" if keys else f"{parent} has no keys"
    hint = f"did you mean {dot}{near[0]}?" if near else known_keys
    return f"{path}: unknown key; {hint}"
