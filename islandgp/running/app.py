"""The Hydra entry: `python -m islandgp`, one run or a sweep.

All configurations of the command are composed and validated before Hydra's launcher starts the
first run.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

import hydra
from hydra._internal.utils import get_args_parser
from hydra.errors import HydraException

from islandgp.config.api_key import NONE, key_in, without_key
from islandgp.config.compose import Planned, is_sweep_file, planned
from islandgp.config.errors import USER_ERRORS, explain, parsed
from islandgp.config.naming import command_line
from islandgp.config.reads import must_be_read
from islandgp.config.sources import ConfigSource
from islandgp.errors import ConfigError, IslandError, PartError
from islandgp.gate import cleaned
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import redacted, without_credentials
from islandgp.resources import resource
from islandgp.running.parts import check_parts
from islandgp.running.printing import checked_stdout, echo, tolerant_stderr
from islandgp.running.report import MOSTLY_FALLBACK
from islandgp.running.resume import choose
from islandgp.running.run import run
from islandgp.running.stopping import as_ctrl_c

if TYPE_CHECKING:
    from islandgp.sweep.run import Job


def main(arguments: Sequence[str] | None = None) -> int:
    """Executes the command line.

    Returns:
        The exit code. 0: all runs are finished; 1: a job failed; 2: an error of the user; 3: all
        runs are finished, but in one the language model's fallback gave more of the answers than
        allowed; 130: stopped by Ctrl-C, SIGTERM or SIGHUP.
    """
    with tolerant_stderr():
        return _main(arguments)


def _main(arguments: Sequence[str] | None) -> int:
    try:
        argv = without_key(sys.argv[1:] if arguments is None else arguments)
        if "--version" in argv:
            echo(f"islandgp, version {version('islandgp')}; Hydra {version('hydra-core')}")
            return 0
        args, argv = parsed_argv(argv)
        # Clusters send SIGTERM, a terminal that closes SIGHUP.
        with checked_stdout(), as_ctrl_c("SIGTERM", "SIGHUP"):
            _must_be_somewhere()
            if args.help or args.hydra_help or args.info or args.cfg or args.shell_completion:
                _show(args, argv)
                return 0
            return _run_all(args, argv)
    except IslandError as error:
        if isinstance(error, PartError):
            traceback.print_exception(error.__cause__)
        print(cleaned(f"islandgp: {without_credentials(str(error))}"), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("islandgp: stopped; the same command continues the run", file=sys.stderr)
        return 130
    except Exception as error:
        from islandgp.running.shortage import shortage  # only for an error

        if reason := shortage(error):
            print(f"islandgp: {reason}", file=sys.stderr)
            return 2
        traceback.print_exc()
        print("islandgp: this is a bug in islandgp; the run's records are kept", file=sys.stderr)
        return 1


def _must_be_somewhere() -> None:
    """Raises ConfigError if the working folder has been deleted."""
    try:
        Path.cwd()
    except FileNotFoundError:
        raise ConfigError(
            "Expected a folder to work in, found that it was deleted; change to another one."
        ) from None


def _run_all(args: argparse.Namespace, argv: list[str]) -> int:
    """Executes the parsed command; returns the exit code."""
    jobs = _planned(args, argv)
    if key_in(job.config for job in jobs):
        args, argv = parsed_argv([NONE, *argv])
        jobs = _planned(args, argv)

    def launch(job: Job, extra: list[str]) -> None:
        _start([*extra, *argv], job)

    for one in jobs:
        folder = RunFolder(one.folder)
        if not choose(folder, one.settings, redacted(one.config)).finished():
            check_parts(one.settings)
    if args.multirun:
        from islandgp.sweep.run import run_sweep  # only for sweeps

        return run_sweep(jobs, command_line(argv), launch)
    _must_not_need_hydra(args.overrides)
    return _run_single(jobs[0], command_line(argv))


def _planned(args: argparse.Namespace, argv: Sequence[str]) -> list[Planned]:
    """The command's jobs. Prints progress."""
    if args.run and args.multirun:
        raise ConfigError("--run: expected no --multirun beside it, found both; leave one out")
    args.multirun = args.multirun or (not args.run and is_sweep_file(args, ConfigSource.of(args)))
    jobs: list[Planned] = []
    for job in planned(args, argv, Path.cwd()):
        jobs.append(job)
        if len(jobs) % 100 == 0:
            print(f"islandgp: {len(jobs)} configurations checked", file=sys.stderr)
    must_be_read(jobs, ConfigSource.of(args))
    return jobs


def _start(argv: Sequence[str], job: Job) -> None:
    """Starts Hydra, whose launcher calls `job`."""
    old = sys.argv
    sys.argv = ["islandgp", *argv]
    # Otherwise Hydra prints its own traceback for a job's error and exits with 1.
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")
    try:
        folder = str(resource("conf"))
        hydra.main(version_base="1.3", config_path=folder, config_name="config")(job)()
    finally:
        sys.argv = old


def _show(args: argparse.Namespace, argv: Sequence[str]) -> None:
    """Prints help, a composed configuration, or other information of Hydra."""
    source = ConfigSource.of(args)
    parsed(args.overrides, source)
    if args.hydra_help:  # the options of Hydra only
        argv = ["--hydra-help"]
    try:
        _start(argv, lambda _: None)
    except SystemExit as end:  # Hydra has printed the error
        sys.exit(2 if end.code else 0)
    except USER_ERRORS as error:  # e.g. options that exclude each other
        if isinstance(error, OSError) and not isinstance(error, HydraException):
            raise  # the output's: the configuration has been read
        raise ConfigError(explain(error, args.overrides, source)) from None


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


ACCEPTED_KEYS: Final = ("launcher", "sweeper", "searchpath")
"""Keys of Hydra that a single run accepts."""


def _must_not_need_hydra(overrides: Sequence[str]) -> None:
    """Raises ConfigError for a key of Hydra that has an effect on the jobs of a sweep only.

    Keys of launchers and sweepers are accepted, as the same command may be used with -m.
    """
    for override in overrides:
        key = override.partition("=")[0].lstrip("+~")
        if key.startswith("hydra.") and key.split(".")[1] not in ACCEPTED_KEYS:
            raise ConfigError(
                f"{key}: expected keys of islandgp, found one of Hydra, which has no effect on a"
                " single run; leave it out, or start a sweep with -m."
            )


def _run_single(job: Planned, command: str) -> int:
    """Run the only job of a command; return the exit code. Raises the errors of the run."""
    end = run(job.settings, job.config, job.folder, home=Path.cwd(), command=command)
    echo(end.text)
    if end.mostly_fallback:
        print(f"islandgp: {MOSTLY_FALLBACK}", file=sys.stderr)
        return 3
    return 0
