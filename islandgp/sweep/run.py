"""A sweep: runs its jobs with any launcher, and reports their results at the end.

The result of a job is read from its folder, so it is available with any launcher, and also if its
process died.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from hydra.core.override_parser.types import Quote, QuotedString
from omegaconf import DictConfig

from islandgp.atomic_files import remove_leftovers
from islandgp.config.compose import Planned
from islandgp.config.settings import Settings
from islandgp.errors import ConfigError, RunError, brief
from islandgp.evaluation.processes import end_with_parent
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import identity_config, redacted
from islandgp.running.parts import supervised_runs
from islandgp.running.printing import echo
from islandgp.running.report import MOSTLY_FALLBACK, is_mostly_fallback
from islandgp.running.resume import choose, differences
from islandgp.sweep.folder import SweepFolder, SweepJob
from islandgp.sweep.job import sweep_entry, sweep_job
from islandgp.sweep.progress import SweepStart, Watch
from islandgp.sweep.summary import arm_lines, arms, identical_arms, power_line

Job = Callable[[DictConfig], Any]
"""The function that Hydra calls for each job."""

Launch = Callable[[Job, list[str]], None]
"""(job function, further overrides): starts Hydra with the job function."""

Entries = dict[SweepFolder, dict[Path, SweepJob]]
"""The jobs of each sweep, by the folder named by a job's configuration.

A command that sweeps over `name` has several sweeps.
"""


def run_sweep(jobs: Sequence[Planned], command: str, launch: Launch) -> int:
    """Runs the jobs.

    Returns:
        The exit code. 0: all jobs are finished; 1: jobs failed; 3: a fallback gave too many of the
        answers; 130: Ctrl-C.

    Raises:
        ConfigError: two jobs are the same run, or would share a folder.
        RunError: another sweep is at work in the same folder, or the launcher starts no job.
    """
    entries = _entries(jobs)
    if runs := supervised_runs(job.settings for job in jobs):
        from islandgp.supervision.llm.estimate import costs  # only with a language model

        echo(costs(runs))
    interrupted = False
    with ExitStack() as stack:
        for sweep, by_folder in entries.items():
            sweep.open(command, list(by_folder.values()))
            stack.callback(sweep.close)
            remove_leftovers(sweep.path, "sweep.json.*")
            if (file := sweep.read()) is not None and (line := power_line(file)):
                echo(line)
        try:
            _launch_all(jobs, entries, launch)
        except KeyboardInterrupt:
            interrupted = True
    return finish_sweep(entries, [job.settings for job in jobs], interrupted)


def finish_sweep(entries: Entries, settings: Sequence[Settings], interrupted: bool) -> int:
    """Sends missing records to the tracking store and prints the results; returns the exit code."""
    try:
        _send(entries, settings)
    except KeyboardInterrupt:
        interrupted = True
    for sweep in entries:
        if (file := sweep.read()) is not None:
            summaries = arms(sweep, file)
            echo(f"\n{arm_lines(summaries)}\n\nResults: {sweep.path}")
            for names in identical_arms(sweep, summaries):
                echo(f"Identical records, run by run: {', '.join(names)}")
    if interrupted:
        print("islandgp: stopped; the same command continues the run", file=sys.stderr)
        return 130
    return _report_unfinished(entries) or _report_fallbacks(entries)


def _entries(jobs: Sequence[Planned]) -> Entries:
    _must_differ(jobs)
    sweeps: dict[Path, dict[Path, SweepJob]] = {}
    for job in jobs:
        folder = choose(RunFolder(job.folder), job.settings, redacted(job.config)).path
        entry = sweep_entry(job.config, job.overrides, job.folder, folder, job.command)
        sweeps.setdefault(job.folder.parent, {})[job.folder] = entry
    return {SweepFolder(path): by_folder for path, by_folder in sweeps.items()}


def _must_differ(jobs: Sequence[Planned]) -> None:
    """Raises ConfigError if two jobs are the same run, or would share a folder."""
    configs: dict[Hashable, Planned] = {}
    folders: dict[Path, Planned] = {}
    for job in jobs:
        same = configs.setdefault(_frozen(identity_config(redacted(job.config))), job)
        if same is not job:
            names = " and ".join(dict.fromkeys([same.folder.name, job.folder.name]))
            raise ConfigError(
                f"Expected jobs that differ, found two that are the same run: {names};"
                " take one of them out of the sweep."
            )
        other = folders.setdefault(job.folder, job)
        if other is not job:
            changed = differences(redacted(other.config), redacted(job.config))
            raise ConfigError(
                f"Expected a folder for each job, found two jobs in {job.folder} that differ in"
                f" {', '.join(changed)}; give each of them another name=..."
            )


def _frozen(value: Any) -> Hashable:
    """Plain values as a hashable key: 1 equals 1.0, and None equals a missing key."""
    if isinstance(value, Mapping):
        return frozenset((key, _frozen(v)) for key, v in value.items() if v is not None)
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def jobs_in(entries: Entries) -> list[tuple[RunFolder, SweepJob]]:
    """All jobs, with the folders that they run in."""
    return [
        (sweep.run(job), job) for sweep, by_folder in entries.items() for job in by_folder.values()
    ]


def _launch_all(jobs: Sequence[Planned], entries: Entries, launch: Launch) -> None:
    """Launches the unfinished jobs, and shows their progress.

    Raises:
        RunError: the launcher has not started any job.
    """
    first, path = jobs[0], next(iter(entries)).path
    start = SweepStart.now(
        {named: job for by_folder in entries.values() for named, job in by_folder.items()}
    )
    abouts = [run.path / "about.json" for run in start.runs()]
    before = [file.exists() for file in abouts]
    if first.launcher == "JoblibLauncher":
        tie_joblib_workers()
    place = QuotedString(str(path), Quote.single).with_quotes()
    try:
        with Watch(start, "off" if first.launcher == "BasicLauncher" else first.settings.progress):
            launch(sweep_job(start), [f"hydra.sweep.dir={place}"])
    except Exception as error:
        if before == [file.exists() for file in abouts] and not all(before):
            raise RunError(
                "Expected the launcher to start the jobs, found that it cannot:"
                f" {brief(error)}; change hydra.launcher, or choose another hydra/launcher."
            ) from None
        print(f"islandgp: the launcher failed ({brief(error)})", file=sys.stderr)
    finally:
        # Hydra writes the whole command into this message, including secrets.
        (path / "multirun.yaml").unlink(missing_ok=True)


def _send(entries: Entries, settings: Sequence[Settings]) -> None:
    """Sends the final states of the jobs and of the sweep to the tracking store."""
    from islandgp.tracking.mlflow import MLflow, send_sweeps

    parts = [s.tracking for s in settings if s.tracking.factory is MLflow]
    trackers = [MLflow.make(part.settings(), Path.cwd()) for part in parts]
    if trackers and (message := send_sweeps([sweep.path for sweep in entries], trackers)):
        print(message, file=sys.stderr)


def _report_unfinished(entries: Entries) -> int:
    """Lists each job that is not finished with the command that runs it again."""
    jobs = jobs_in(entries)
    bad = [(run, job) for run, job in jobs if not run.finished()]
    if not bad:
        return 0
    print(f"\n{len(bad)} of {len(jobs)} jobs not finished:", file=sys.stderr)
    for run, job in bad:
        busy = run.status() is Status.RUNNING
        ended = run.reason() or ("its process died" if run.begun() else "not started")
        reason = "another process is at work on it" if busy else ended
        print(f"\n  {job.folder}: {reason}", file=sys.stderr)
        if run.error():
            print(f"    error:  {run.path / 'error.txt'}", file=sys.stderr)
        print(f"    again:  {job.command}", file=sys.stderr)
    return 1


def _report_fallbacks(entries: Entries) -> int:
    """Lists each job in which a language model's fallback gave too many of the answers."""
    runs = [run for run, _ in jobs_in(entries)]
    bad = [run for run in runs if is_mostly_fallback(run.summary())]
    if not bad:
        return 0
    print(f"\nislandgp: in {len(bad)} of {len(runs)} jobs {MOSTLY_FALLBACK}", file=sys.stderr)
    for run in bad:
        print(f"  {run.path.name}", file=sys.stderr)
    return 3


def tie_joblib_workers() -> None:
    """Makes joblib's future workers end with this process."""
    from joblib import register_parallel_backend  # type: ignore[import-untyped] # as above
    from joblib.parallel import LokyBackend  # type: ignore[import-untyped] # it has no types

    class Tied(LokyBackend):  # type: ignore[misc] # joblib has no types
        def configure(self, *args: Any, **options: Any) -> Any:
            """Sets an initializer of joblib's executor, which each worker calls at its start."""
            return super().configure(
                *args, initializer=partial(end_with_parent, os.getpid()), **options
            )

    register_parallel_backend("loky", Tied)  # the name that Hydra's launcher uses
