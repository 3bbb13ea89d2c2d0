"""A command line as jobs: what each would run and where, validated before anything starts."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

from hydra import compose, initialize_config_dir
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from islandgp.errors import ConfigError
from islandgp.resources import resource
from islandgp.settings import Settings, read_settings, unknown_key
from islandgp.tracking.parameters import HIDDEN, MACHINERY, is_secret

NOT_IN_FOLDER: Final = MACHINERY | {
    "hydra",
    "name",
    "seed",
    "experiment",
    "supervisor",
    "supervisor.policy.base_url",
}
"""Overrides that a run's folder name leaves out, or says otherwise."""

EXTRAS: Final = {"joblib": "joblib", "ray": "ray", "submitit": "submitit"}
"""What to install for a launcher of Hydra's that is not there."""


@dataclass(frozen=True, slots=True)
class Planned:
    """One job of a command."""

    overrides: tuple[str, ...]
    config: dict[str, Any]  # resolved, as plain values
    settings: Settings
    folder: Path  # absolute, where the run keeps its records
    command: str  # that runs this job alone
    launcher: str  # the class name of Hydra's launcher


def planned(args: argparse.Namespace, words: Sequence[str], home: Path) -> Iterator[Planned]:
    """The jobs of a command. Raises ConfigError at the first that is wrong."""
    flags = _flags(words, args)
    for overrides in _jobs(args):
        composed = _composed(overrides, args)
        launcher = str(composed.hydra.launcher["_target_"]).rpartition(".")[2]
        with open_dict(composed):
            del composed["hydra"]  # what it holds is known only when Hydra runs
        config, settings = read(composed)
        ours = [o for o in overrides if _group(o) != "hydra"]
        yield Planned(
            tuple(ours),
            config,
            settings,
            run_folder(settings, ours, home),
            command_line([*flags, *ours]),
            launcher,
        )


def read(config: DictConfig) -> tuple[dict[str, Any], Settings]:
    """A composed configuration as plain values and as settings. Raises ConfigError."""
    plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(plain, dict)
    ours = {str(k): v for k, v in plain.items() if k != "hydra"}
    return ours, read_settings(ours)


def run_folder(settings: Settings, overrides: Sequence[str], home: Path) -> Path:
    """Where a run keeps its records: <runs>/<name>/<supervisor>-seed<n>[-<overrides>]."""
    last = {_key(override): override for override in overrides}  # Hydra takes the last of a key
    words = [
        re.sub(r"[^A-Za-z0-9._=,+-]+", "_", override)
        for key, override in last.items()
        if key not in NOT_IN_FOLDER
        and (key.startswith("supervisor.") or _group(key) not in NOT_IN_FOLDER)
        and not is_secret(key)
    ]
    leaf = "-".join([f"{settings.supervisor.name}-seed{settings.seed}", *sorted(words)])
    return (home / settings.runs / settings.name / leaf[:180]).resolve()


def is_choice(override: str) -> bool:
    """Whether an override tells arms apart: all do but name, seed, machinery and secrets."""
    group = _group(override)
    return not is_secret(_key(override)) and group not in MACHINERY | {"hydra", "name", "seed"}


def command_line(words: Sequence[str]) -> str:
    """The command for a shell, secrets hidden."""
    shown = [f"{w.partition('=')[0]}={HIDDEN}" if is_secret(_key(w)) else w for w in words]
    return shlex.join(["python", "-m", "islandgp", *shown])


def _key(override: str) -> str:
    return override.lstrip("+~").partition("=")[0].partition("@")[0]


def _group(override: str) -> str:
    return _key(override).split(".")[0].split("/")[0]


def _flags(words: Sequence[str], args: argparse.Namespace) -> list[str]:
    """The words that are neither overrides nor ask for a sweep: --config-dir and the like."""
    overrides = set(args.overrides)
    return [w for w in words if w not in overrides and w not in ("-m", "--multirun")]


def _jobs(args: argparse.Namespace) -> Iterator[list[str]]:
    """The overrides of each job of the command."""
    try:
        parsed = OverridesParser.create().parse_overrides(args.overrides)
    except HydraException as error:
        raise ConfigError(_short(error)) from None
    if not args.multirun:
        sweeps = [o.input_line for o in parsed if o.is_sweep_override()]
        if sweeps:
            raise ConfigError(
                f"{sweeps[0]}: expected one value, found a sweep; add -m to run all of them."
            )
        yield list(args.overrides)
        return
    for batch in BasicSweeper.split_arguments(parsed, None):
        yield from (list(job) for job in batch)


def _composed(overrides: list[str], args: argparse.Namespace) -> DictConfig:
    folder = Path(args.config_path or resource("conf")).resolve()
    search = (
        [f"hydra.searchpath=[file://{Path(args.config_dir).resolve()}]"] if args.config_dir else []
    )
    try:
        with initialize_config_dir(str(folder), version_base="1.3"):
            return compose(
                args.config_name or "config", [*overrides, *search], return_hydra_config=True
            )
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(_explain(error)) from None


def _explain(error: Exception) -> str:
    """Hydra's complaint in our form: what was expected, what was found, the nearest right one."""
    text = str(error)
    if match := re.search(r"Could not override '([^']+)'", text):
        return unknown_key(match[1], _known_beside(match[1]))
    if match := re.search(r"(?:load|find) 'hydra/launcher/(joblib|ray|submitit)\w*'", text):
        return (
            f"hydra/launcher: expected Hydra's {match[1]} launcher, found it not installed;"
            f" pip install 'islandgp[{EXTRAS[match[1]]}]'"
        )
    if match := re.search(
        r"Could not find '([^']+)'[\s\S]*?Available options in '[^']*':\n([\s\S]*)", text
    ):
        group, _, option = match[1].rpartition("/")
        known = re.findall(r"^\t(\S+)$", match[2], re.MULTILINE)
        near = get_close_matches(option, known, 1, 0.5)
        hint = f"did you mean {near[0]}? " if near else ""
        return f"{group}={option}: unknown option; {hint}there are {', '.join(known)}"
    return _short(error)


def _known_beside(path: str) -> list[str]:
    """The keys of the default configuration at the same place as `path`."""
    with initialize_config_dir(str(resource("conf")), version_base="1.3"):
        at: Any = compose("config")
    for part in path.split(".")[:-1]:
        at = at.get(part, {}) if isinstance(at, DictConfig) else {}
    return [str(key) for key in at]


def _short(error: Exception) -> str:
    """The first line that says something."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__
