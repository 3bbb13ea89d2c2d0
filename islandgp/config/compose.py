"""Composes a command line into jobs, with their settings and folders, and validates them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from math import ceil, isfinite
from pathlib import Path
from typing import Any, Final

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.types import Override, RangeSweep
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from islandgp.config.errors import USER_ERRORS, explain, parsed, unresolved
from islandgp.config.naming import command_line, group_of, run_folder
from islandgp.config.reads import must_be_read
from islandgp.config.settings import DomainSettings, Settings, read_settings, with_generations
from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError
from islandgp.records.parameters import key_of

BASIC: Final = f"{BasicSweeper.__module__}.{BasicSweeper.__qualname__}"
"""Hydra's basic sweeper, which runs every combination."""

MAX_JOBS: Final = 1000  # of a command; all are checked before the first one starts


@dataclass(frozen=True, slots=True)
class Planned:
    """One job of a command."""

    overrides: tuple[str, ...]
    config: dict[str, Any]  # resolved, as plain values
    settings: Settings
    folder: Path  # absolute, where the run keeps its records
    command: str  # that runs this job alone
    launcher: str  # the class name of Hydra's launcher


def only_job(overrides: Sequence[str], config_dir: str | Path | None = None) -> Planned:
    """The job of a command with these overrides. Raises ConfigError, also for a sweep."""
    if options := [word for word in overrides if word.startswith("-")]:
        raise ConfigError(
            f"Expected overrides (KEY=VALUE), found the option {options[0]}; for a sweep make one"
            " experiment for each value, for a folder of your own give config_dir."
        )
    flags = ["--config-dir", str(config_dir)] if config_dir is not None else []
    args = get_args_parser().parse_args([*flags, *overrides])
    job = next(planned(args, overrides, Path.cwd()))
    must_be_read([job], ConfigSource.of(args))
    return job


def planned(args: argparse.Namespace, argv: Sequence[str], home: Path) -> Iterator[Planned]:
    """The jobs of a command. Raises ConfigError for the first invalid one."""
    flags, source = flags_of(args, argv), ConfigSource.of(args)
    for overrides in _jobs(args, source):
        yield _plan(composed_config(overrides, source), overrides, flags, home)


def _swept(args: argparse.Namespace, source: ConfigSource) -> list[Override]:
    """The overrides of a sweep: those of `hydra.sweeper.params` come first.

    Raises:
        ConfigError: an override, or the sweeper, is wrong.
    """
    overrides = parsed(args.overrides, source)
    if not _sets_hydra(args):
        return overrides  # the sweeper is Hydra's default
    sweeper = _component(_first_job(overrides, source).hydra, "sweeper")
    if sweeper.get("_target_") != BASIC:
        raise ConfigError(
            f"hydra/sweeper: expected Hydra's basic sweeper, found {sweeper.get('_target_')};"
            " leave it out, or search in Python: examples/optuna_search.py."
        )
    params = [f"{key}={value}" for key, value in (sweeper.get("params") or {}).items()]
    last = {key_of(str(o.input_line)): o for o in [*parsed(params, source), *overrides]}
    return list(last.values())


def _sets_hydra(args: argparse.Namespace) -> bool:
    """True if the command, or a file of the user, may set keys of Hydra."""
    words = [o for o in args.overrides if o.lstrip("+~").startswith("hydra")]
    return bool(words or args.config_dir or args.config_path or args.config_name)


def is_sweep_file(args: argparse.Namespace, source: ConfigSource) -> bool:
    """True if a file sets `hydra.mode: MULTIRUN`, which is the same as -m. Raises ConfigError."""
    if not _sets_hydra(args):
        return False
    return _first_job(parsed(args.overrides, source), source).hydra.mode is RunMode.MULTIRUN


def _first_job(overrides: Sequence[Override], source: ConfigSource) -> DictConfig:
    """The configuration with the first value of each sweep. Raises ConfigError."""
    return composed_config([_with_first_value(override) for override in overrides], source)


def _with_first_value(override: Override) -> str:
    """The override with the first value of its sweep."""
    if not override.is_sweep_override():
        return str(override.input_line)
    _must_have_values([override])
    return f"{override.get_key_element()}={next(override.sweep_string_iterator())}"


def _plan(
    composed: DictConfig, overrides: Sequence[str], flags: Sequence[str], home: Path
) -> Planned:
    """The job of a composed configuration. Raises ConfigError if it is invalid."""
    launcher = str(_component(composed.hydra, "launcher")["_target_"]).rpartition(".")[2]
    _must_have_no_callbacks(composed.hydra)
    _must_leave_folders(composed.hydra)
    domain = composed.hydra.runtime.choices.get("domain")  # None: the first file names it
    with open_dict(composed):
        del composed["hydra"]  # its values are resolved only when Hydra runs
    config, settings = read(composed)
    if domain is not None:
        _must_be_called(str(domain), settings)
    job_overrides = [o for o in overrides if group_of(o) != "hydra"]
    _must_change_something(job_overrides, composed)
    return Planned(
        tuple(job_overrides),
        config,
        settings,
        run_folder(config, job_overrides, home),
        command_line([*flags, *job_overrides]),
        launcher,
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


def plain(config: DictConfig) -> dict[str, Any]:
    """A composed configuration as plain values. Raises ConfigError."""
    values = {key: value for key, value in resolved(config).items() if key != "hydra"}
    return dict(with_generations(values))


def read(config: DictConfig) -> tuple[dict[str, Any], Settings]:
    """A composed configuration as plain values and as settings. Raises ConfigError."""
    plain_config = plain(config)
    return plain_config, read_settings(plain_config)


def flags_of(args: argparse.Namespace, argv: Sequence[str]) -> list[str]:
    """The options of a command other than -m, e.g. --config-dir."""
    overrides = set(args.overrides)
    return [a for a in argv if a not in overrides and a not in ("-m", "--multirun")]


def _jobs(args: argparse.Namespace, source: ConfigSource) -> Iterator[list[str]]:
    """The overrides of each job of the command."""
    if not args.multirun:
        overrides = parsed(args.overrides, source)
        if sweep := next((o for o in overrides if o.is_sweep_override()), None):
            raise ConfigError(
                f"{sweep.input_line}: expected one value, found a sweep; give one, or add -m"
                " to python -m islandgp to run all of them."
            )
        yield list(args.overrides)
        return
    overrides = _swept(args, source)
    sweeps = [override for override in overrides if override.is_sweep_override()]
    try:
        _must_have_values(sweeps)
        batches = BasicSweeper.split_arguments(overrides, None)
    except HydraException as error:
        raise ConfigError(explain(error, args.overrides, source)) from None
    for batch in batches:
        yield from (list(job) for job in batch)


def _must_have_values(sweeps: Sequence[Override]) -> None:
    """Raises ConfigError for a sweep without values, or with too many jobs."""
    jobs = 1
    for sweep in sweeps:
        if not sweep.is_discrete_sweep():
            raise ConfigError(
                f"{sweep.input_line}: expected values to sweep over, found an interval; write"
                f" {sweep.key_or_group}=range(START,STOP,STEP), or search in Python:"
                " examples/optuna_search.py."
            )
        jobs *= _values(sweep)
        if jobs > MAX_JOBS:
            count = f"{jobs:,}" if jobs < 10**12 else "far more"
            raise ConfigError(
                f"{sweep.input_line}: expected at most {MAX_JOBS:,} jobs of a command, found"
                f" {count}; give them in parts: commands with the same name are one sweep."
            )


def _values(sweep: Override) -> int:
    """Number of values of a sweep, without a list of them. Raises ConfigError if there are none."""
    sweep_values = sweep.value()
    if isinstance(sweep_values, RangeSweep):
        n = _steps(sweep, sweep_values)
    else:
        n = sum(1 for _ in islice(sweep.sweep_string_iterator(), MAX_JOBS + 1))
    if not n:
        raise ConfigError(
            f"{sweep.input_line}: expected a sweep over at least one value, found none;"
            " give it some, or leave it out."
        )
    return n


def _steps(sweep: Override, values: RangeSweep) -> int:
    start, stop, step = values.start or 0, values.stop or 0, values.step
    if not step or not all(isfinite(number) for number in (start, stop, step)):
        raise ConfigError(
            f"{sweep.input_line}: expected a range with an end and a step that is not 0, found"
            f" the step {step}; write range(START,STOP,STEP)."
        )
    return max(0, ceil(Fraction(stop) / Fraction(step) - Fraction(start) / Fraction(step)))


def composed_config(overrides: list[str], source: ConfigSource) -> DictConfig:
    try:
        composed = source.compose(overrides)
    except USER_ERRORS as error:
        raise ConfigError(explain(error, overrides, source)) from None
    for group in ("domain", "experiment"):
        below = composed.get(group)
        keys = Settings.model_fields.keys() - DomainSettings.model_fields.keys()
        if isinstance(below, DictConfig) and keys & set(map(str, below)):
            raise ConfigError(
                f"{group}={composed.hydra.runtime.choices.get(group)}: expected"
                " `# @package _global_` as the first line of the file, found none; add it, so that"
                " its keys are those of the whole configuration."
            )
    return composed


def _must_change_something(overrides: Sequence[str], composed: DictConfig) -> None:
    """Raises ConfigError for `KEY={}` if KEY has keys, as Hydra keeps them."""
    for override in overrides:
        key, _, value = override.partition("=")
        if value.replace(" ", "") == "{}" and OmegaConf.select(composed, key_of(override)):
            raise ConfigError(
                f"{override}: expected keys to add or change, found none; remove keys with"
                f" ~{key.lstrip('+')}.NAME."
            )


def _component(hydra: DictConfig, group: str) -> dict[str, Any]:
    """The configuration of Hydra's launcher or sweeper. Raises ConfigError for a wrong one."""
    component = hydra[group]
    if not isinstance(component, DictConfig):
        raise ConfigError(
            f"hydra.{group}: expected keys with values, found {component}; choose one by"
            f" hydra/{group}=NAME."
        )
    return resolved(component)


def _must_have_no_callbacks(hydra: DictConfig) -> None:
    """Raises ConfigError for callbacks, as they would run any code."""
    others = {k: v for k, v in (hydra.callbacks or {}).items() if (k, v) not in CALLBACKS.items()}
    if others:
        first = f"hydra.callbacks.{next(iter(others))}"
        raise ConfigError(
            f"{first}: expected no callbacks, found one; leave it out, or write a supervisor or"
            " an evaluator of your own"
        )


CALLBACKS: Final = {"forget": {"_target_": "islandgp.sweep.job.Forget"}}
"""Hydra's callbacks in conf/config.yaml."""

FIXED_SETTINGS: Final = {
    "run.dir": ".",
    "sweep.dir": ".",
    "sweep.subdir": ".",
    "output_subdir": None,
    "job.chdir": False,
}
"""Hydra's settings of job folders in conf/config.yaml."""


def _must_leave_folders(hydra: DictConfig) -> None:
    """Raises ConfigError if a command sets folders by Hydra's keys."""
    for key, fixed in FIXED_SETTINGS.items():
        settings = OmegaConf.to_container(hydra, resolve=False)
        for part in key.split("."):
            settings = settings.get(part) if isinstance(settings, dict) else None
        if settings != fixed:
            raise ConfigError(
                f"hydra.{key}: expected {'null' if fixed is None else str(fixed).lower()}, found"
                f" {settings}; records go to <runs>/<name>/: choose these by runs=FOLDER and"
                " name=NAME."
            )


def resolved(config: DictConfig) -> dict[str, Any]:
    """The plain values. Raises ConfigError if an interpolation cannot be resolved."""
    try:
        plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise ConfigError(unresolved(error)) from None
    assert isinstance(plain, dict)
    return {str(key): value for key, value in plain.items()}
