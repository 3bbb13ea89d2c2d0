"""The Hydra entry: `python -m islandgp`, one run or a sweep.

All configurations of the command are composed and validated before the first run starts.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

import hydra
from hydra._internal.utils import get_args_parser
from hydra.errors import HydraException

from islandgp.config.compose import command_line, planned
from islandgp.config.errors import USER_ERRORS, explain, parsed
from islandgp.config.reads import must_be_read
from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import redacted
from islandgp.resources import resource
from islandgp.running.console import as_ctrl_c, echo, exit_code
from islandgp.running.parts import check_parts
from islandgp.running.report import MOSTLY_FALLBACK, is_mostly_fallback
from islandgp.running.resume import choose
from islandgp.running.run import run


def main(arguments: Sequence[str] | None = None) -> int:
    """Executes the command line.

    Returns:
        The exit code. 0: all runs are finished; 1: a job failed; 2: an error of the user; 3: all
        runs are finished, but in one the language model's fallback gave more of the answers than
        allowed; 130: stopped by Ctrl-C, SIGTERM or SIGHUP.
    """
    words = sys.argv[1:] if arguments is None else arguments
    return exit_code(lambda: _main(words), "stopped; the same command continues the run")


def _main(arguments: Sequence[str]) -> int:
    if "--version" in arguments:
        echo(f"islandgp, version {version('islandgp')}; Hydra {version('hydra-core')}")
        return 0
    args, argv = parsed_argv(arguments)
    with as_ctrl_c("SIGTERM", "SIGHUP"):  # of a cluster, and of a terminal that closes
        home = _working_folder()
        if args.help or args.hydra_help or args.info or args.cfg or args.shell_completion:
            _show(args, argv)
            return 0
        return _run_all(args, argv, home)


def _working_folder() -> Path:
    """The current folder. Raises ConfigError if it has been deleted."""
    try:
        return Path.cwd()
    except FileNotFoundError:
        raise ConfigError(
            "Expected a folder to work in, found that it was deleted; change to another one."
        ) from None


def _run_all(args: argparse.Namespace, argv: list[str], home: Path) -> int:
    """Executes the parsed command; returns the exit code. Raises the errors of a single run."""
    jobs = []
    for job in planned(args, argv, home):
        jobs.append(job)
        if len(jobs) % 100 == 0:
            print(f"islandgp: {len(jobs)} configurations checked", file=sys.stderr)
    must_be_read(jobs, ConfigSource.of(args))
    for job in jobs:
        if not choose(RunFolder(job.folder), job.settings, redacted(job.config)).finished():
            check_parts(job.settings)
    if job.launcher:
        from islandgp.running.sweep import run_sweep  # only for sweeps

        return run_sweep(jobs, command_line(argv), home)
    folder, text = run(job.settings, job.config, job.folder, home=home, command=command_line(argv))
    echo(text)
    if is_mostly_fallback(folder.summary()):
        print(f"islandgp: {MOSTLY_FALLBACK}", file=sys.stderr)
        return 3
    return 0


def _show(args: argparse.Namespace, argv: Sequence[str]) -> None:
    """Prints help, a composed configuration, or other information of Hydra."""
    source = ConfigSource.of(args)
    parsed(args.overrides, source)
    old, sys.argv = sys.argv, ["islandgp", *(["--hydra-help"] if args.hydra_help else argv)]
    # Otherwise Hydra prints its own traceback for an error and exits with 1.
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    try:
        folder = str(resource("conf"))
        hydra.main(version_base="1.3", config_path=folder, config_name="config")(lambda _: None)()
    except SystemExit as end:  # Hydra has printed the error
        sys.exit(2 if end.code else 0)
    except USER_ERRORS as error:  # e.g. options that exclude each other
        if isinstance(error, OSError) and not isinstance(error, HydraException):
            raise  # the output's: the configuration has been read
        raise ConfigError(explain(error, args.overrides, source)) from None
    finally:
        sys.argv = old


def parsed_argv(argv: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """The parsed command line, and its arguments with the overrides before the options.

    Raises:
        ConfigError: Hydra does not have an option.
    """
    parser = get_args_parser()
    parser.error = _refuse  # type: ignore[method-assign]  # no usage lines, no exit
    args = parser.parse_intermixed_args(argv)
    options = [word for word in argv if word not in set(args.overrides)]
    return args, [*args.overrides, *options]


def _refuse(message: str) -> NoReturn:
    raise ConfigError(
        f"{message}; settings are written as KEY=VALUE, e.g. seed=3;"
        " `python -m islandgp --help` has the options."
    )
