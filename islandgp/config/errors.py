"""Errors of Hydra, OmegaConf, YAML and pydantic as messages of one line each.

Three mistakes have messages of this project: unknown keys, unknown options, and values that cannot
be read. All others are in the words of the library.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from typing import Any, Final

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import ValidationError

from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError, brief
from islandgp.records.parameters import key_of, secret_in
from islandgp.text_files import read_text_file

USER_ERRORS: Final = (
    HydraException,
    OmegaConfBaseException,
    yaml.YAMLError,
    ValueError,
    TypeError,  # for a word in place of a number after a list; others are faults of the program
    OSError,
    RecursionError,
)
"""Exceptions of Hydra and OmegaConf for a user's error."""

UNKNOWN_KEY: Final = r"Could not (?:override|delete from config\.) '([^'@]+)'(?! is )"
UNKNOWN_OPTION: Final = r"Could not find '(.*)/(.+)'[\s\S]*?Available options in '.*':\n([\s\S]*)"
"""Messages of Hydra."""


def parsed(overrides: Sequence[str], source: ConfigSource) -> list[Override]:
    """The overrides parsed by Hydra.

    Raises:
        ConfigError: one cannot be read, or has a secret, which other processes could read.
    """
    for override in overrides:
        if secret := secret_in(override):
            raise ConfigError(
                f"{key_of(override)}: expected no secret on the command line, found {secret}; set"
                " ANTHROPIC_API_KEY or OPENAI_API_KEY in the environment, or write it into a file"
                " of your configuration folder (--config-dir)."
            )
    parser = OverridesParser.create(config_loader=source.loader())
    overrides_read: list[Override] = []
    for override in overrides:
        try:
            overrides_read += parser.parse_overrides([override])
        except (HydraException, ValueError, RecursionError) as error:
            raise ConfigError(_unreadable(override, error)) from None
    return overrides_read


def _unreadable(override: str, error: Exception) -> str:
    key, _, value = override.partition("=")
    first = [line for line in str(error).splitlines() if not line.startswith("Error parsing")]
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    quoted = shlex.quote(f'{key}="{escaped}"')
    return (
        f"{override:.200}: expected KEY=VALUE, found what cannot be read"
        f" ({(first or [type(error).__name__])[0]}); a text needs quotes inside and out:"
        f" {quoted:.200}"
    )


def explain(error: Exception, overrides: Sequence[str], source: ConfigSource) -> str:
    """The message for an error of composing these overrides. Raises a TypeError of the program.

    Raises IslandError for a file that is not UTF-8.
    """
    text = str(error).partition("\nConfig search path:")[0]
    if isinstance(error, TypeError) and "is not an int" not in text:
        raise error
    if isinstance(error, UnicodeDecodeError):  # it does not say in which file
        for folder in source.folders():
            for file in sorted(folder.rglob("*.yaml")):
                read_text_file(file)
    if (match := re.search(UNKNOWN_KEY, text)) and not source.options(match[1]):
        loader = source.loader()
        choices = [o for o in overrides if loader.get_group_options(o.partition("=")[0])]
        config = OmegaConf.to_container(source.compose(choices), resolve=False)
        key = match[1]
        return unknown_key(key, config, lambda: _elsewhere(key, choices, source))
    if match := re.search(UNKNOWN_OPTION, text):
        return unknown_option(match[1], match[2], re.findall(r"^\t(\S+)$", match[3], re.MULTILINE))
    cause = f" ({brief(error.__cause__)})" if isinstance(error.__cause__, Exception) else ""
    return f"{' '.join(text.split())}{cause}"


def _elsewhere(key: str, choices: Sequence[str], source: ConfigSource) -> str:
    """The option of the key's group that has the key, as GROUP=OPTION; "" if none has it."""
    group = "search" if key.startswith("allocation.") else key.partition(".")[0]
    others = [choice for choice in choices if key_of(choice) != group]
    for chosen in ([], *([f"{group}={option}"] for option in source.options(group))):
        with suppress(*USER_ERRORS):
            config = source.compose([*others, *chosen])
            if OmegaConf.select(config, key) is not None:
                return f"{group}={config.hydra.runtime.choices[group]}"
    return ""


def unknown_option(group: str, option: str, options: Sequence[str]) -> str:
    """The message for an option that a group does not have, with the nearest one."""
    near = get_close_matches(option, options, 1, 0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"{group}={option}: unknown option; {hint}there are {', '.join(options)}"


def unknown_key(
    path: str, config: Any, elsewhere: Callable[[], str] = str, others: Sequence[str] = ()
) -> str:
    """The message for a dotted key that `config` does not have.

    It names a key that is spelt almost so, or the option that has it as `elsewhere` finds it, or a
    key of the same name in another place, but none of the `others` that are unknown as well.
    """
    unknown = tuple(f"{each}." for each in (path, *others))
    keys = [key for key in _keys(config) if not f"{key}.".startswith(unknown)]
    last = [key for key in keys if key.rpartition(".")[2] == path.rpartition(".")[2]]
    near = get_close_matches(path, keys, 1, 0.85)
    if not near and (option := elsewhere()):
        return f"{path}: unknown key; {option} has it."
    near = near or get_close_matches(path, last, 1, 0.5)
    remedy = (
        f"did you mean {near[0]}?"
        if near
        else f"--cfg job prints those there are; if it has no value yet, write +{path}=VALUE."
    )
    return f"{path}: unknown key; {remedy}"


def _keys(config: Any, at: str = "") -> Iterator[str]:
    """All dotted keys of a configuration, those of lists by their numbers."""
    entries: Iterable[tuple[Any, Any]] = enumerate(config) if isinstance(config, list) else ()
    for key, value in config.items() if isinstance(config, Mapping) else entries:
        yield f"{at}{key}"
        yield from _keys(value, f"{at}{key}.")


def unresolved(error: OmegaConfBaseException) -> str:
    """The message for an interpolation that cannot be resolved."""
    key = error.full_key or ""
    return f"{key}: expected a value, found none ({brief(error)}); give {key}=VALUE"


def error_lines(
    error: ValidationError, config: Any, at: str = "", fields: Collection[str] = ()
) -> Iterator[str]:
    """A line for each error of validating `config`.

    Args:
        error: of pydantic.
        config: plain values.
        at: path of `config`.
        fields: names that keys may have, also if `config` has none of them.
    """
    details = error.errors(include_url=False)
    inside = {e["loc"][:n] for e in details for n in range(len(e["loc"]))}
    paths = [".".join(str(part) for part in ((at, *e["loc"]) if at else e["loc"])) for e in details]
    # A key without a value may be the one that is meant by an unknown one.
    missing = {p: None for p, e in zip(paths, details, strict=True) if e["type"] == "missing"}
    unknown = [p for p, e in zip(paths, details, strict=True) if e["type"] == "extra_forbidden"]
    for path, e in zip(paths, details, strict=True):
        if e["type"] == "too_short" and e["loc"] in inside:
            continue  # errors within items are reported only once
        message = e["msg"].removeprefix("Value error, ")
        if e["type"] == "extra_forbidden":
            parent, _, name = path.rpartition(".")
            meant = {f"{parent}.{n}": None for n in get_close_matches(name, fields, 1, 0.8)}
            keys = {**({at: config} if at else config), **missing, **meant}
            yield unknown_key(path, keys, others=unknown)
        elif e["type"] == "value_error":
            colon = "." if re.match(r"[a-z0-9_.]+: ", message) else ": "  # it begins with a key
            yield f"{path}{colon}{message}" if path else message
        elif e["type"] == "missing":
            yield f"{path}: expected a value, found none"
        else:
            yield f"{path}={e['input']!r}: {message[0].lower()}{message[1:]}"
