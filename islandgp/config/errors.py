"""Errors of Hydra, OmegaConf, YAML and pydantic as messages of one line each.

Three mistakes have messages of this project: unknown keys, unknown options, and values that cannot
be read. All others are in the words of the library.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from types import UnionType
from typing import Any, Final, Union, get_args, get_origin

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import BaseModel, ValidationError

from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError, IslandError, brief
from islandgp.plugin import ComponentConfig, imported
from islandgp.records.parameters import is_secret
from islandgp.redaction import HIDDEN
from islandgp.text_files import decoded

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


def parsed(overrides: Sequence[str], source: ConfigSource) -> list[Override]:
    """The overrides parsed by Hydra. Raises ConfigError for the first that cannot be read."""
    parser = OverridesParser.create(config_loader=source.loader())
    overrides_read: list[Override] = []
    for override in overrides:
        try:
            overrides_read += parser.parse_overrides([override])
        except (HydraException, ValueError, RecursionError) as error:
            raise ConfigError(_unreadable(override, error)) from None
    return overrides_read


def _unreadable(override: str, error: Exception) -> str:
    key, equals, value = override.partition("=")
    if is_secret(key):
        return f"{key}={HIDDEN}: expected KEY=VALUE, found a value that cannot be read; quote it"
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    quoted = shlex.quote(f'{key}="{escaped}"')
    remedy = f"a text needs quotes inside and out: {quoted}"
    if not equals:
        remedy = f"write {key}=VALUE, or islandgp {key} if it is a command"
    elif value.startswith("~"):
        remedy = "write the path whole, as only shells expand ~"
    elif len(override) > 200:
        override, remedy = f"{override[:100]}...", "write a shorter value"
    first, *more = [*str(error).splitlines(), type(error).__name__]
    reason = more[0] if first.startswith("Error parsing override") else first
    return f"{override}: expected KEY=VALUE, found what cannot be read ({reason}); {remedy}"


def explain(error: Exception, overrides: Sequence[str], source: ConfigSource) -> str:
    """The message for an error of composing these overrides. Raises a TypeError of the program."""
    text = str(error).partition("\nConfig search path:")[0]
    if isinstance(error, TypeError) and "is not an int" not in text:
        raise error
    for pattern, message in RULES:
        if match := re.search(pattern, text):
            return (
                match.expand(message)
                if isinstance(message, str)
                else message(match, overrides, source)
            )
    cause = f" ({brief(error.__cause__)})" if isinstance(error.__cause__, Exception) else ""
    start = "Expected YAML, found: " if isinstance(error, yaml.YAMLError) else ""
    return f"{start}{' '.join(text.split())}{cause}"


def _no_such_key(match: re.Match[str], overrides: Sequence[str], source: ConfigSource) -> str:
    if source.options(match[1]):  # a group without an option in the chosen files
        return " ".join(match.string.split())
    loader = source.loader()
    groups = [o for o in parsed(overrides, source) if loader.get_group_options(o.key_or_group)]
    chosen = source.compose([o.input_line for o in groups if o.input_line is not None])
    key, config = match[1], OmegaConf.to_container(chosen, resolve=False)
    for option in source.options("allocation") if key.startswith("allocation.") else ():
        if f"\n{key.split('.')[1]}:" in source.files(f"allocation/{option}")[-1].read_text("utf-8"):
            return f"{key}: not a slot of the chosen search; search={option} has it."
    line = unknown_key(key, config)
    is_beside = f"did you mean {key.rpartition('.')[0]}" in line
    return line if is_beside else f"{line} If it has no value yet, write +{key}=VALUE."


def _no_such_option(match: re.Match[str], *_: object) -> str:
    group, _slash, option = match[1].rpartition("/")
    return unknown_option(group, option, re.findall(r"^\t(\S+)$", match[2], re.MULTILINE))


def _broken_file(match: re.Match[str], _: object, source: ConfigSource) -> str:
    """The message for the first file that is not UTF-8, or has no keys, if there is one."""
    folders = source.folders()[1:] or [source.folder]  # the package's own files are right
    for file in sorted(file for folder in folders for file in folder.rglob("*.yaml")):
        try:
            content = yaml.safe_load(decoded(file.read_bytes(), str(file)))
        except IslandError as error:
            return str(error)
        except yaml.YAMLError:  # not a file of this command, or its error would be reported
            continue
        if content is not None and not isinstance(content, dict):
            kind = type(content).__name__
            return f"Expected keys with values in {file}, found a {kind}; write KEY: VALUE lines."
    return (
        f"Expected one option of a group, found several; add -m. ({match.string.splitlines()[0]})"
    )


Message = Callable[[re.Match[str], Sequence[str], ConfigSource], str]

RULES: Final[tuple[tuple[str, str | Message], ...]] = (
    (r"Could not (?:override|delete from config\.) '([^'@]+)'(?! is )", _no_such_key),
    (
        r"(?:load|find) 'hydra/launcher/(joblib|submitit)\w*'",
        r"hydra/launcher: expected Hydra's \1 launcher, found it not installed;"
        r" pip install 'islandgp[\1]'",
    ),
    (r"Cannot merge DictConfig with ListConfig|codec can't decode", _broken_file),
    (
        "maximum recursion depth exceeded",
        "Expected a configuration of a few levels, found a nesting too deep to be read.",
    ),
    (r"Could not find '([^']+)'[\s\S]*?Available options in '[^']*':\n([\s\S]*)", _no_such_option),
)
"""Patterns in Hydra's messages, with the message in their place: a template, or a function."""


def unknown_option(group: str, option: str, options: Sequence[str]) -> str:
    """The message for an option that a group does not have, with the nearest one."""
    near = get_close_matches(option, options, 1, 0.5)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"{group}={option}: unknown option; {hint}there are {', '.join(options)}"


def unknown_key(path: str, config: Any, at: str = "") -> str:
    """The message for a dotted key that `config`, the configuration below `at`, does not have."""
    keys = [key.rpartition(".") for key in _keys(config, at) if key != path]
    above, _, last = path.rpartition(".")
    beside = get_close_matches(last, [name for up, _, name in keys if up == above], 1, 0.5)
    elsewhere = ["".join(key) for key in keys if key[2] == last and not last.isdecimal()]
    if beside or (elsewhere := get_close_matches(path, elsewhere, 1, 0.5)):
        near = f"{above}.{beside[0]}".lstrip(".") if beside else elsewhere[0]
        return f"{path}: unknown key; did you mean {near}?"
    while above != at and above not in map("".join, keys):
        above = above.rpartition(".")[0]
    known = [name for up, _, name in keys if up == above]
    found = f"there are {', '.join(known)}" if known else f"{above} has no keys"
    return f"{path}: unknown key; {found}."


def _keys(config: Any, at: str) -> Iterator[str]:
    """All dotted keys of a configuration, those of lists by their numbers."""
    entries = enumerate(config) if isinstance(config, list) else ()
    for key, value in config.items() if isinstance(config, Mapping) else entries:
        path = f"{at}.{key}" if at else str(key)
        if not str(key).startswith("_"):
            yield path
            yield from _keys(value, path)


def unresolved(error: OmegaConfBaseException) -> str:
    """The message for an interpolation that cannot be resolved."""
    key = error.full_key or ""
    return f"{key}: expected a value, found none ({brief(error)}); give {key}=VALUE"


def error_lines(
    error: ValidationError, config: Any, model: type[BaseModel], at: str = ""
) -> Iterator[str]:
    """A line for each error of validating `config` with `model`; `at` is the path of `config`."""
    details = error.errors(include_url=False)
    inside = {e["loc"][:n] for e in details for n in range(len(e["loc"]))}
    for e in details:
        if e["type"] == "too_short" and e["loc"] in inside:
            continue  # errors within items are reported only once
        path = ".".join(str(part) for part in ((at, *e["loc"]) if at else e["loc"]))
        message = e["msg"].removeprefix("Value error, ")
        if e["type"] == "extra_forbidden":
            fields = keys_at(config, e["loc"][:-1], model)
            yield unknown_key(path, dict.fromkeys(fields), path.rpartition(".")[0])
        elif e["type"] == "value_error":
            colon = "." if re.match(r"[a-z0-9_.]+: ", message) else ": "  # it begins with a key
            yield f"{path}{colon}{message}" if path else message
        elif e["type"] == "missing":
            yield f"{path}: expected a value, found none"
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


def setting_at(settings: Any, key: int | str) -> Any:
    """The value at a key of plain configuration, or of settings; None if there is none."""
    if isinstance(settings, ComponentConfig) and key == "policy":
        return settings.settings()
    if isinstance(settings, Mapping):
        return settings.get(key)
    if isinstance(settings, list):
        return settings[key] if isinstance(key, int) else None
    return getattr(settings, str(key), None)
