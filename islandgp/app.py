"""The Hydra entry: `python -m islandgp`, one run or a sweep.

Every configuration of the command is composed and validated before the first
run starts; only then Hydra's launcher takes over.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import hydra
from hydra import compose, initialize_config_dir
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from islandgp.errors import ConfigError, IslandError
from islandgp.resources import resource
from islandgp.run import run
from islandgp.settings import Settings, read_settings, unknown_key

NOT_IN_FOLDER = frozenset({"name", "seed", "supervisor", "runs", "resume", "progress"})
"""Overrides that a run's folder name says otherwise, or that do not change its records."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0, 2 for a user's error, 130 for Ctrl-C."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    args = get_args_parser().parse_args(words)
    hydra_only = args.help or args.hydra_help or args.info or args.cfg or args.shell_completion
    try:
        if not hydra_only:
            for job in _jobs(args):
                _check(job, args)
        _start(words)
    except IslandError as error:
        print(f"islandgp: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("islandgp: stopped; the same command goes on from here", file=sys.stderr)
        return 130
    return 0


def _start(words: Sequence[str]) -> None:
    old = sys.argv
    sys.argv = ["islandgp", *words]
    # Else Hydra prints a traceback of its own for a job's error, and exits with 1.
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    try:
        hydra.main(version_base="1.3", config_path=str(resource("conf")), config_name="config")(
            _job
        )()
    finally:
        sys.argv = old


def _job(config: DictConfig) -> None:
    """One job of the command, in whatever process the launcher chose."""
    plain, settings = _read(config)
    home = Path(HydraConfig.get().runtime.cwd)
    folder = run_folder(settings, list(HydraConfig.get().overrides.task), home)
    print(run(settings, plain, folder, home=home))


def _read(config: DictConfig) -> tuple[dict[str, Any], Settings]:
    plain = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(plain, dict)
    ours = {str(k): v for k, v in plain.items() if k != "hydra"}
    return ours, read_settings(ours)


def run_folder(settings: Settings, overrides: Sequence[str], home: Path) -> Path:
    """Where a run keeps its records: <runs>/<name>/<supervisor>-seed<n>[-<overrides>]."""
    words = []
    for override in overrides:
        key = override.lstrip("+~").partition("=")[0].partition("@")[0]
        if key.split(".")[0] not in {"evaluator", "tracking", "experiment"} | NOT_IN_FOLDER or (
            key.startswith("supervisor.")
        ):
            words.append(re.sub(r"[^A-Za-z0-9._=,+-]+", "_", override))
    leaf = "-".join([f"{settings.supervisor.name}-seed{settings.seed}", *sorted(words)])
    return (home / settings.runs / settings.name / leaf[:180]).resolve()


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


def _check(overrides: list[str], args: argparse.Namespace) -> None:
    """Composes one job's configuration and validates it. Raises ConfigError."""
    folder = Path(args.config_path or resource("conf")).resolve()
    search = (
        [f"hydra.searchpath=[file://{Path(args.config_dir).resolve()}]"] if args.config_dir else []
    )
    try:
        with initialize_config_dir(str(folder), version_base="1.3"):
            config = compose(args.config_name or "config", [*overrides, *search])
        _read(config)
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigError(_explain(error)) from None


def _explain(error: Exception) -> str:
    """Hydra's complaint in our form: what was expected, what was found, the nearest right one."""
    text = str(error)
    if match := re.search(r"Could not override '([^']+)'", text):
        return unknown_key(match[1], _known_beside(match[1]))
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
