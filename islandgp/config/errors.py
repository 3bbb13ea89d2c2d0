"""Errors of Hydra, OmegaConf and YAML as one-line messages: expected, found, remedy."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from importlib.util import find_spec
from itertools import accumulate
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from islandgp.config.error_lines import keys_at, unknown_key, unknown_option
from islandgp.config.settings import Settings
from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError, IslandError
from islandgp.records.parameters import flatten, is_secret
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

LEVELS: Final = 50  # most levels of brackets in a value
MAX_KEY: Final = 200  # most characters of a key, as Hydra uses it as a file name
DIGITS: Final = 1000  # most digits of a number


def parsed(overrides: Sequence[str], source: ConfigSource) -> list[Override]:
    """The overrides parsed by Hydra. Raises ConfigError for the first invalid one."""
    parser = OverridesParser.create(config_loader=source.loader())
    overrides_read: list[Override] = []
    for override in overrides:
        if not override.lstrip("+~").partition("=")[0]:
            raise ConfigError(f"{override}: expected KEY=VALUE, found no key; write KEY=VALUE")
        _must_be_readable(override)
        try:
            overrides_read += parser.parse_overrides([override])
        except HydraException:
            raise ConfigError(_unreadable(override, parser)) from None
    return overrides_read


def _must_be_readable(override: str) -> None:
    """Raises ConfigError for a value that Hydra's parser or Python cannot process."""
    key, _, value = override.partition("=")
    if len(key) > MAX_KEY:
        raise ConfigError(
            f"{key[:20]}...: expected a key of at most {MAX_KEY} characters, found {len(key):,};"
            " write a shorter one"
        )
    steps = ((character in "[{(") - (character in "]})") for character in value)
    deepest = max(accumulate(steps, initial=0))
    if deepest > LEVELS:
        raise ConfigError(
            f"{key}: expected a value of at most {LEVELS} levels of brackets, found {deepest};"
            " write a flatter one"
        )
    digits = max(map(len, re.findall(r"\d+", value)), default=0)
    if digits > DIGITS:
        raise ConfigError(
            f"{key}: expected a number of at most {DIGITS} digits, found {digits}; write a"
            " shorter one"
        )


def _unreadable(override: str, parser: OverridesParser) -> str:
    key, equals, value = override.partition("=")
    if override.isidentifier() and find_spec(f"islandgp.commands.{override}_command"):
        return f"{override}: expected KEY=VALUE, found a command; write islandgp {override}"
    if not equals:
        return f"{override}: expected KEY=VALUE, found no =; write {override}=VALUE"
    if is_secret(key):
        return f"{key}={HIDDEN}: expected a value, found one that cannot be read; quote it"
    if value.startswith("~"):
        return f"{override}: expected a path, found ~, which only shells expand; write it whole"
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    quoted = f'{key}="{escaped}"'
    try:
        parser.parse_override(quoted)
    except HydraException:
        return f"{override}: expected KEY=VALUE, found a key that cannot be read; correct the key"
    return (
        f"{override}: expected a value, found one that cannot be read; correct it, or quote it"
        f" inside and out where it is a text: {shlex.quote(quoted)}"
    )


class Mistake(NamedTuple):
    """An error of composing a configuration."""

    error: Exception
    overrides: Sequence[str]
    source: ConfigSource

    def parsed(self) -> list[Override]:
        """The overrides, as parsed by Hydra."""
        return parsed(self.overrides, self.source)

    def chosen(self) -> Any:
        """The unresolved configuration of the chosen options, without overrides of values."""
        loader = self.source.loader()
        groups = [o for o in self.parsed() if loader.get_group_options(o.key_or_group)]
        composed = self.source.compose([o.input_line for o in groups if o.input_line is not None])
        return OmegaConf.to_container(composed, resolve=False)


def explain(error: Exception, overrides: Sequence[str], source: ConfigSource) -> str:
    """The message for an error of composing these overrides. Raises a TypeError of the program."""
    mistake, text = Mistake(error, overrides, source), str(error)
    if isinstance(error, TypeError):
        if line := _no_entry(mistake):
            return line
        raise error
    if isinstance(error, yaml.YAMLError):
        return _yaml(error)
    if isinstance(error, RecursionError):
        return "Expected a configuration of a few levels, found a nesting too deep to be read."
    if isinstance(error, UnicodeDecodeError):
        return _no_text(source) or _short(error)
    for pattern, message in RULES:
        if match := re.search(pattern, text, re.MULTILINE):
            line = message(mistake, match) if callable(message) else match.expand(message)
            return line or _short(error)
    return _short(error)


def _no_experiment(mistake: Mistake, _: re.Match[str]) -> str:
    return _no_option(mistake) or (
        "domain: expected the name of an option, found none; there are"
        f" {', '.join(mistake.source.options('domain'))}"
    )


def _no_such_key(mistake: Mistake, match: re.Match[str]) -> str:
    key = match[1]
    if mistake.source.options(key):
        return (
            f"{key}: expected a group that the chosen files have an option of, found none; write"
            f" +{key}=OPTION for an option on top of that file"
        )
    return _no_entry(mistake) or _unknown(key, mistake.chosen())


def _no_such_option(_: Mistake, match: re.Match[str]) -> str:
    group, _slash, option = match[1].rpartition("/")
    return unknown_option(group, option, re.findall(r"^\t(\S+)$", match[2], re.MULTILINE))


def _cannot_merge(mistake: Mistake, match: re.Match[str]) -> str:
    if line := _no_entry(mistake):
        return line
    cause = mistake.error.__cause__
    return f"{match[1]}: {_short(cause)}" if isinstance(cause, Exception) else ""


RULES: Final[tuple[tuple[str, str | Callable[[Mistake, re.Match[str]], str]], ...]] = (
    ("with ListConfig", lambda m, _: _no_mapping(m.source) or _no_option(m)),
    (
        r"Ambiguous value for argument '(.+)'",
        r"\1: expected one value, found a sweep; give one of them",
    ),
    (
        r"(?:Multiple values for |^)([^.\s]+)(?:\. To | appears more than once)",
        r"\1: expected one option, found another one added to it; write \1=OPTION, without +",
    ),
    (r"\$\{experiment\}_\$\{domain\}", _no_experiment),
    ("Config group override must be", lambda m, _: _no_option(m)),
    (
        r"Could not override '([^'@]+)@([^']*)'",
        r"\1@\2: expected GROUP=OPTION, found a package after the group; write \1=OPTION",
    ),
    (r"Could not override '([^']+)'", _no_such_key),
    (r"Could not delete from config. '([^']+)' does not exist", _no_such_key),
    (
        r"Could not delete from config. The value of '([^']+)' is (.*) and not (.*)\.",
        r"\1: expected its value \2 behind ~, found \3; write ~\1",
    ),
    (
        r"Could not append to config. An item is already at '([^']+)'",
        r"\1: expected a new key after +, found one that has a value; write \1=VALUE, without +",
    ),
    (
        r"(?:load|find) 'hydra/launcher/(joblib|ray|submitit)\w*'",
        r"hydra/launcher: expected Hydra's \1 launcher, found it not installed;"
        r" pip install 'islandgp[\1]'",
    ),
    (r"Could not find '([^']+)'[\s\S]*?Available options in '[^']*':\n([\s\S]*)", _no_such_option),
    (r"\AError merging override ([\s\S]*)", _cannot_merge),
    (r"\Ainvalid literal for int\(\)", lambda m, _: _no_entry(m)),
)
"""Patterns in Hydra's messages, with the replacement: a template, or a function. "" keeps Hydra's
first line."""


GLOBAL_PACKAGE: Final = re.compile(r"^\s*#\s*@package\s+_global_\s*$", re.MULTILINE)
"""The line with which Hydra applies a group's file to the whole configuration."""


def check_packages(composed: DictConfig, source: ConfigSource) -> None:
    """Raises ConfigError for a domain or an experiment without the line `# @package _global_`.

    Hydra then puts all of its keys below the group, e.g. `world` at `domain.world`.
    """
    for group, group_keys in (("domain", {"factory"}), ("experiment", set[str]())):
        choice, below = composed.hydra.runtime.choices.get(group), composed.get(group)
        if choice is None or not isinstance(below, DictConfig):
            continue
        if not set(map(str, below)) & (Settings.model_fields.keys() - group_keys):
            continue
        for file in source.files(f"{group}/{choice}"):
            if not GLOBAL_PACKAGE.search(file.read_text(encoding="utf-8")):
                raise ConfigError(
                    f"{group}={choice}: expected `# @package _global_` as the first line of {file},"
                    " whose keys are those of the whole configuration, found none; add it."
                )


def unresolved(error: OmegaConfBaseException) -> str:
    """The message for an interpolation that cannot be resolved."""
    key, reason = error.full_key or "", _short(error)
    if match := re.search(r'"(.+)"$', reason):  # the message of a resolver
        reason = match[1]
    return f"{key}: expected a value, found none ({reason}); give {key}=VALUE"


def _yaml(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return (
            f"Expected YAML in {mark.name}, found a mistake in line {mark.line + 1}, column"
            f" {mark.column + 1}: {error.problem}; correct it there."
        )
    return f"Expected YAML, found: {' '.join(str(error).split())}; correct it there."


def _no_text(source: ConfigSource) -> str:
    """The message for the user's first file that is not UTF-8, or ""."""
    for file in _files(source):
        try:
            decoded(file.read_bytes(), str(file))
        except IslandError as error:
            return str(error)
    return ""


def _no_mapping(source: ConfigSource) -> str:
    """The message for the user's first file whose content is not a mapping, or ""."""
    for file in _files(source):
        try:
            content = yaml.safe_load(file.read_bytes())
        except yaml.YAMLError:  # not a file of this command, or its error would be reported before
            continue
        if content is not None and not isinstance(content, dict):
            return (
                f"Expected keys with values in {file}, found a {type(content).__name__}; write"
                " KEY: VALUE lines."
            )
    return ""


def _files(source: ConfigSource) -> list[Path]:
    return sorted((source.user_folder or source.folder).rglob("*.yaml"))


def _no_option(mistake: Mistake) -> str:
    """The message for a group that is set to a list, a number or null, or ""."""
    for override in mistake.parsed():
        key, value = override.key_or_group, override.value()
        options = mistake.source.options(key)
        if not options or isinstance(value, str) or override.is_delete():
            continue
        option = (override.input_line or "").partition("=")[2]
        if isinstance(value, list):
            return (
                f"{key}={option}: expected the name of an option, found a list; write"
                f" {key}={option.strip('[] ')} -m for a run with each"
            )
        return (
            f"{key}={option}: expected the name of an option, found {option};"
            f" there are {', '.join(options)}; for none leave it out"
        )
    return ""


def _no_entry(mistake: Mistake) -> str:
    """The message for the first key with an entry of a list that the list does not have, or ""."""
    config = mistake.chosen()
    for override in mistake.parsed():
        value, parts = config, override.key_or_group.split(".")
        for i, part in enumerate(parts):
            if isinstance(value, dict):
                value = value.get(part)
            elif isinstance(value, list) and part.isdecimal() and int(part) < len(value):
                value = value[int(part)]
            elif isinstance(value, list):
                numbers = f"a number from 0 to {len(value) - 1}" if value else "no further key"
                return (
                    f"{override.key_or_group}: expected {numbers} after {'.'.join(parts[:i])},"
                    f" which is a list of {len(value)}, found {part}"
                )
    return ""


def _unknown(path: str, config: Any) -> str:
    """The message for a key that is not in the configuration, about its first unknown part."""
    parts = path.split(".")
    keys = keys_at(config, parts[:-1], Settings)
    if len(parts) > 1 and parts[-1] in keys:
        return f"{path}: expected a key that has a value, found none; write +{path}=VALUE"
    same = [key for key in flatten(config) if key.rpartition(".")[2] == parts[-1]]
    if near := get_close_matches(path, same, 1, 0.5):
        return f"{path}: unknown key; did you mean {near[0]}?"
    for i, part in enumerate(parts[:-1]):
        if part not in config:
            near = get_close_matches(part, _keys(config), 1, 0.5)
            above = ".".join(parts[:i]) or "the configuration"
            hint = (
                f"did you mean {'.'.join([*parts[:i], near[0], *parts[i + 1 :]])}?"
                if near
                else f"{above} has {', '.join(_keys(config)) or 'no keys'}"
            )
            return f"{path}: unknown key; {hint}"
        config = _entries(config[part])
    return unknown_key(path, keys)


def _entries(value: Any) -> dict[str, Any]:
    """The values below a value by their keys; those of a list by their numbers."""
    if isinstance(value, list):
        return {str(k): entry for k, entry in enumerate(value)}
    return value if isinstance(value, dict) else {}


def _keys(config: dict[str, Any]) -> list[str]:
    return [key for key in config if not key.startswith("_")]


def _short(error: Exception) -> str:
    """The first line of a message that is not blank; with the next one if it ends in a colon."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if len(lines) > 1 and lines[0].endswith(":"):
        return f"{lines[0]} {lines[1]}"
    return lines[0] if lines else type(error).__name__
