"""Composes a command line into jobs, with their settings and folders, and validates them."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.types import Override
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from islandgp.config.errors import USER_ERRORS, explain, parsed, unresolved
from islandgp.config.reads import must_be_read
from islandgp.config.settings import Settings, read_settings
from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError
from islandgp.records.parameters import RUNTIME_KEYS, ending_in_digest, key_of, without_credentials

NOT_IN_FOLDER: Final = RUNTIME_KEYS | {
    "hydra",
    "name",
    "seed",
    "experiment",
    "supervisor",
    "supervisor.policy.base_url",
}
"""Keys and groups that are not appended to the name of a run's folder."""

MAX_LENGTH: Final = 180  # most characters of a folder's name; file systems allow 255 bytes


def run_folder(config: Mapping[str, Any], overrides: Sequence[str], home: Path) -> Path:
    """The folder of a run: <runs>/<name>/<supervisor>-seed<n>[-<overrides>].

    Characters with a meaning in shells or file systems are replaced by `_`. A changed or shortened
    name ends with a digest of the full one, so different overrides have different names.
    """
    last = {key_of(override): override for override in overrides}  # Hydra takes the last of a key
    choices = [
        override
        for key, override in last.items()
        if key not in NOT_IN_FOLDER
        and (key.startswith("supervisor.") or group_of(key) not in NOT_IN_FOLDER)
    ]
    leaf = "-".join([f"{config['supervisor']['name']}-seed{int(config['seed'])}", *sorted(choices)])
    return (home / str(config["runs"]) / str(config["name"]) / _safe(leaf)).resolve()


def _safe(name: str) -> str:
    """The name as a valid folder name; see `run_folder`."""
    safe = re.sub(r"[^A-Za-z0-9._=,+-]+", "_", name)
    if safe == name and len(name) <= MAX_LENGTH:
        return name
    return ending_in_digest(safe, name, MAX_LENGTH)


def is_choice(override: str) -> bool:
    """True if the override is part of an arm's identity."""
    return group_of(override) not in RUNTIME_KEYS | {"hydra", "name", "seed"}


def command_line(argv: Sequence[str]) -> str:
    """The command for a shell, with passwords in addresses hidden."""
    return shlex.join(["python", "-m", "islandgp", *map(without_credentials, argv)])


def group_of(override: str) -> str:
    """The first part of that key."""
    return key_of(override).split(".")[0].split("/")[0]


MAX_JOBS: Final = 1000  # of a command; all are checked before the first one starts

HYDRA_KEYS: Final = ("hydra.launcher", "hydra.mode", "hydra.searchpath", "hydra.sweeper.params")
"""The keys of Hydra that have an effect."""


@dataclass(frozen=True, slots=True)
class Planned:
    """One job of a command."""

    overrides: tuple[str, ...]
    config: dict[str, Any]  # resolved, as plain values
    settings: Settings
    folder: Path  # absolute, where the run keeps its records
    command: str  # that runs this job alone
    launcher: dict[str, Any]  # of a sweep; {}: a single run


def only_job(overrides: Sequence[str], config_dir: str | Path | None = None) -> Planned:
    """The job of a command with these overrides. Raises ConfigError, also for a sweep."""
    if options := [word for word in overrides if word.startswith("-")]:
        raise ConfigError(
            f"Expected overrides (KEY=VALUE), found the option {options[0]}; for a sweep make one"
            " experiment for each value, for a folder of your own give config_dir."
        )
    flags = ["--config-dir", str(config_dir)] if config_dir is not None else []
    args = get_args_parser().parse_args([*flags, "--run", *overrides])
    (job,) = planned(args, flags, Path.cwd())
    must_be_read([job], ConfigSource.of(args))
    return job


def planned(args: argparse.Namespace, argv: Sequence[str], home: Path) -> Iterator[Planned]:
    """The jobs of a command. Raises ConfigError for the first invalid one."""
    source, batches = ConfigSource.of(args), [list(args.overrides)]
    overrides = parsed(args.overrides, source)
    for key in map(key_of, args.overrides):
        if key.startswith("hydra") and not key.replace("/", ".").startswith(HYDRA_KEYS):
            raise ConfigError(
                f"{key}: expected a key of islandgp or one of {', '.join(HYDRA_KEYS)}, found one"
                " without effect; records go to <runs>/<name>/: choose these by"
                " runs=FOLDER and name=NAME."
            )
    is_sweep = args.multirun
    if args.run and args.multirun:
        raise ConfigError("--run: expected no --multirun beside it, found both; leave one out.")
    if _may_set_hydra(args):
        hydra = composed_config([_with_first_value(o) for o in overrides], source).hydra
        is_sweep = is_sweep or (not args.run and hydra.mode is RunMode.MULTIRUN)
        params = [f"{key}={value}" for key, value in (hydra.sweeper.get("params") or {}).items()]
        by_key = {key_of(str(o.input_line)): o for o in [*parsed(params, source), *overrides]}
        overrides = list(by_key.values()) if is_sweep else overrides
    if is_sweep:
        _must_have_values([override for override in overrides if override.is_sweep_override()])
        batches = BasicSweeper.split_arguments(overrides, None)[0]
    elif sweep := next((o for o in overrides if o.is_sweep_override()), None):
        raise ConfigError(
            f"{sweep.input_line}: expected one value, found a sweep; give one, or add -m to"
            " python -m islandgp to run all of them."
        )
    words = {*args.overrides, "-m", "--multirun"}
    flags = [word for word in argv if word not in words]
    for batch in batches:
        yield _plan(composed_config(batch, source), batch, flags, home, sweep=is_sweep)


def _may_set_hydra(args: argparse.Namespace) -> bool:
    """True if the command, or a file of the user, may set keys of Hydra."""
    words = [o for o in args.overrides if o.lstrip("+~").startswith("hydra")]
    return bool(words or args.config_dir or args.config_name)


def _with_first_value(override: Override) -> str:
    """The override with the first value of its sweep."""
    if not override.is_sweep_override():
        return str(override.input_line)
    _must_have_values([override])
    return f"{override.get_key_element()}={next(override.sweep_string_iterator())}"


def _must_have_values(sweeps: Sequence[Override]) -> None:
    """Raises ConfigError for a sweep without values, or with too many jobs."""
    jobs = 1
    for sweep in sweeps:
        try:
            values = sweep.sweep_string_iterator() if sweep.is_discrete_sweep() else iter(())
            jobs *= sum(1 for _ in islice(values, MAX_JOBS + 1))
        except ValueError:  # a step of 0
            jobs = 0
        if not 0 < jobs <= MAX_JOBS:
            raise ConfigError(
                f"{sweep.input_line}: expected 1 to {MAX_JOBS:,} jobs of a command, found"
                f" {'more' if jobs else 'none'}; write values as A,B or range(START,STOP,STEP), and"
                " give large sweeps in parts: commands with the same name are one sweep."
            )


def _plan(
    composed: DictConfig, overrides: Sequence[str], flags: Sequence[str], home: Path, *, sweep: bool
) -> Planned:
    """The job of a composed configuration. Raises ConfigError if it is invalid."""
    launcher, choices = composed.hydra.launcher, composed.hydra.runtime.choices
    if not isinstance(launcher, DictConfig):
        raise ConfigError(f"hydra.launcher: expected hydra/launcher=NAME, found {launcher}.")
    for override in overrides:
        if not sweep and key_of(override).startswith(("hydra/launcher", "hydra.launcher")):
            raise ConfigError(
                f"{override}: expected a sweep, found a single run, which starts no other job; add"
                " -m, or leave it out."
            )
    with open_dict(composed):
        del composed["hydra"]  # its values are resolved only when Hydra runs
    config = resolved(composed)
    settings = read_settings(config)
    config["gp"]["generations"] = settings.gp.generations  # a budget sets them
    if domain := choices.get("domain"):  # else the first file names it
        _must_be_called(str(domain), settings)
    for key in (key_of(override) for override in overrides if override.endswith("={}")):
        if OmegaConf.select(composed, key):  # Hydra keeps the keys that are there
            raise ConfigError(
                f"{key}={{}}: expected keys to add or change, found none; remove keys with"
                f" ~{key}.NAME."
            )
    own = tuple(override for override in overrides if group_of(override) != "hydra")
    return Planned(
        own,
        config,
        settings,
        run_folder(config, own, home),
        command_line([*flags, *own]),
        resolved(launcher) if sweep else {},
    )


def _must_be_called(choice: str, settings: Settings) -> None:
    """Raises ConfigError if the domain's option and its vocabulary have different names."""
    name = settings.make_domain().schema.vocabulary.domain
    if choice.rpartition("/")[2] != name:
        raise ConfigError(
            f"domain={choice}: expected the file of a domain whose vocabulary is called {choice},"
            f" as its trees are to name it, found one called {name!r}; call the file {name}.yaml,"
            " or the vocabulary as the file."
        )


def composed_config(overrides: list[str], source: ConfigSource) -> DictConfig:
    """The configuration, including Hydra's part. Raises ConfigError."""
    try:
        composed = source.compose(overrides)
    except USER_ERRORS as error:
        raise ConfigError(explain(error, overrides, source)) from None
    for group in ("domain", "experiment"):
        misplaced = {"gp", "budget", "classes", "name"} & {*(composed.get(group) or {})}
        if misplaced:
            raise ConfigError(
                f"{group}={composed.hydra.runtime.choices.get(group)}: expected"
                " `# @package _global_` as the first line of the file, found none; add it, so that"
                " its keys are those of the whole configuration."
            )
    return composed


def resolved(config: DictConfig) -> dict[str, Any]:
    """The plain values. Raises ConfigError if an interpolation cannot be resolved."""
    try:
        plain_config = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise ConfigError(unresolved(error)) from None
    assert isinstance(plain_config, dict)
    return {str(key): value for key, value in plain_config.items()}
