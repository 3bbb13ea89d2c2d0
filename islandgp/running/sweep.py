"""A sweep: checks and records its jobs, launches them, and reports their results at the end."""

from __future__ import annotations

import sys
from collections.abc import Hashable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import time
from typing import Any

from islandgp.atomic_files import remove_leftovers
from islandgp.config.compose import Planned
from islandgp.config.naming import is_choice
from islandgp.errors import ConfigError, IslandError, RunError, brief
from islandgp.evaluation.processes import cores
from islandgp.records.arms import arm_table, identical_arms, power_line
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import identity_config, redacted, without_credentials
from islandgp.records.sweep import SweepFolder, SweepJob
from islandgp.running.console import echo
from islandgp.running.launch import SweepTask, jobs_at_once, kind_of, launch
from islandgp.running.parts import supervised_runs
from islandgp.running.report import MOSTLY_FALLBACK, is_mostly_fallback
from islandgp.running.resume import choose, differences


@dataclass(frozen=True, slots=True)
class _Job:
    """A job, and its entry in the file of its sweep."""

    planned: Planned
    sweep: SweepFolder
    entry: SweepJob

    @property
    def run(self) -> RunFolder:
        """The folder of its run."""
        return self.sweep.run(self.entry)


def run_sweep(planned: Sequence[Planned], command: str, home: Path) -> int:
    """Runs the jobs; a command that sweeps over `name` has several sweeps.

    Returns:
        The exit code. 0: all jobs are finished; 1: jobs failed; 3: a fallback gave too many of the
        answers; 130: Ctrl-C.

    Raises:
        ConfigError: two jobs are the same run, or would share a folder.
        RunError: another sweep is at work in the same folder, or the launcher starts no job.
    """
    kind_of(planned[0].launcher)
    _must_differ(planned)
    jobs = [_job(each) for each in planned]
    sweeps = {job.sweep.path: job.sweep for job in jobs}
    if runs := supervised_runs(job.settings for job in planned):
        from islandgp.supervision.llm.estimate import costs  # only with a language model

        echo(costs(runs))
    interrupted = False
    with ExitStack() as stack:
        for path, sweep in sweeps.items():
            sweep.open(command, [job.entry for job in jobs if job.sweep.path == path])
            stack.callback(sweep.close)
            remove_leftovers(path, "sweep.json.*")
            if (file := sweep.read()) is not None and (line := power_line(file)):
                echo(line)
        try:
            _launch(jobs, home)
        except KeyboardInterrupt:
            interrupted = True
    try:
        _send(jobs, home)
    except KeyboardInterrupt:
        interrupted = True
    for sweep in sweeps.values():
        if (file := sweep.read()) is not None:
            echo(f"\n{arm_table(sweep, file)}\n\nResults: {sweep.path}")
            for names in identical_arms(sweep, file):
                echo(f"Identical records, run by run: {', '.join(names)}")
    if interrupted:
        print("islandgp: stopped; the same command continues the run", file=sys.stderr)
        return 130
    return _report(jobs)


def _job(planned: Planned) -> _Job:
    config = planned.config
    entry = SweepJob(
        slot=planned.folder.name,
        folder=choose(RunFolder(planned.folder), planned.settings, redacted(config)).path.name,
        supervisor=str(config["supervisor"]["name"]),
        seed=int(config["seed"]),
        choices=tuple(without_credentials(o) for o in planned.overrides if is_choice(o)),
        generations=int(config["gp"]["generations"]),
        command=planned.command,
    )
    return _Job(planned, SweepFolder(planned.folder.parent), entry)


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


def _launch(jobs: Sequence[_Job], home: Path) -> None:
    """Launches the jobs. Raises RunError if the launcher has not started any job."""
    runs, launcher = [job.run for job in jobs], jobs[0].planned.launcher
    for run in runs:
        (run.path / "error.txt").unlink(missing_ok=True)
    before, started = sum(run.completed_generations() for run in runs), time()
    at_once = jobs_at_once(launcher, len(jobs))
    tasks = [
        SweepTask(
            config=job.planned.config,
            folder=job.run.path,
            command=job.planned.command,
            home=home,
            folders=tuple(run.path for run in runs),
            generations=sum(each.entry.generations for each in jobs),
            before=before,
            started=started,
            workers=max(1, cores() // at_once) if at_once > 1 else 0,
            launcher=kind_of(launcher),
        )
        for job in jobs
    ]
    existed = [run.begun() for run in runs]
    try:
        launch(tasks, launcher, jobs[0].sweep.path)
    except IslandError:
        raise
    except Exception as error:
        if existed == [run.begun() for run in runs] and not all(existed):
            raise RunError(
                "Expected the launcher to start the jobs, found that it cannot:"
                f" {brief(error)}; change hydra.launcher, or choose another hydra/launcher."
            ) from None
        print(f"islandgp: the launcher failed ({brief(error)})", file=sys.stderr)


def _send(jobs: Sequence[_Job], home: Path) -> None:
    """Sends the final states of the jobs and of the sweep to the tracking store."""
    from islandgp.tracking.mlflow import MLflow, send_sweeps

    parts = [job.planned.settings.tracking for job in jobs]
    trackers = [MLflow.make(p.settings(), home) for p in parts if p.factory is MLflow]
    paths = list(dict.fromkeys(job.sweep.path for job in jobs))
    if trackers and (message := send_sweeps(paths, trackers)):
        print(message, file=sys.stderr)


def _report(jobs: Sequence[_Job]) -> int:
    """Lists the jobs that are not finished, or got too many fallbacks; returns the exit code."""
    if bad := [job for job in jobs if not job.run.finished()]:
        print(f"\n{len(bad)} of {len(jobs)} jobs not finished:", file=sys.stderr)
        for job in bad:
            run = job.run
            busy = run.status() is Status.RUNNING
            ended = run.reason() or ("its process died" if run.begun() else "not started")
            reason = "another process is at work on it" if busy else ended
            print(f"\n  {run.path.name}: {reason}", file=sys.stderr)
            if run.error():
                print(f"    error:  {run.path / 'error.txt'}", file=sys.stderr)
            print(f"    again:  {job.entry.command}", file=sys.stderr)
        return 1
    if bad := [job for job in jobs if is_mostly_fallback(job.run.summary())]:
        print(f"\nislandgp: in {len(bad)} of {len(jobs)} jobs {MOSTLY_FALLBACK}", file=sys.stderr)
        for job in bad:
            print(f"  {job.run.path.name}", file=sys.stderr)
        return 3
    return 0
