"""A sweep: checks and records its jobs, launches them, and reports their results at the end."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import time
from typing import Any, Final

from islandgp.atomic_files import remove_leftovers
from islandgp.config.compose import Planned, is_choice
from islandgp.config.settings import Settings, read_settings
from islandgp.errors import BusyError, ConfigError, IslandError, RunError, brief
from islandgp.evaluation.processes import cores, prepare_worker
from islandgp.plugin import ComponentConfig
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import identity_config, redacted, without_credentials
from islandgp.records.sweep import SweepJob, arm_table, at_work, identical_arms, power_line
from islandgp.records.values import validation_mean
from islandgp.running.console import as_ctrl_c, echo, tolerant_stderr
from islandgp.running.parts import supervised_runs
from islandgp.running.report import MOSTLY_FALLBACK, duration, is_mostly_fallback
from islandgp.running.resume import choose
from islandgp.running.run import run as run_one
from islandgp.text import in_points, title

BASIC: Final = "hydra._internal.core_plugins.basic_launcher.BasicLauncher"
"""Hydra's default launcher: one job after the other."""


@dataclass(frozen=True, slots=True)
class SweepTask:
    """One job of a sweep as plain values, which can be sent to its process."""

    config: dict[str, Any]  # resolved
    folder: Path
    command: str  # that runs this job alone
    home: Path  # working folder of the sweep's command
    folders: tuple[Path, ...]  # of all jobs
    generations: int  # of all jobs
    before: int  # generations that existed at the start
    started: float  # s since 1970
    workers: int  # processes of an evaluator that leaves their number open; 0: all cores
    launcher: str  # as from `kind_of`


def kind_of(launcher: Mapping[str, Any]) -> str:
    """The kind of a launcher: basic, processes, slurm or local (Slurm's jobs on this machine).

    Raises:
        ConfigError: it is another one, or starts no job at a time.
    """
    if launcher.get("n_jobs") == 0:
        raise ConfigError("hydra.launcher.n_jobs: expected 1 or more, or -1 (all cores), found 0")
    kinds = {BASIC: "basic", None: "processes" if "n_jobs" in launcher else launcher.get("cluster")}
    if (kind := kinds.get(launcher.get("_target_"))) is None:
        raise ConfigError(
            f"hydra/launcher: expected basic, local, slurm or slurm_try, found {launcher!s:.80}"
        )
    return str(kind)


def launch(tasks: Sequence[SweepTask], launcher: Mapping[str, Any], folder: Path) -> None:
    """Runs the jobs and waits for them; `folder` is for files of Slurm's jobs.

    Raises:
        Exception: of the launcher; those of a job are in its folder.
    """
    kind = kind_of(launcher)
    if kind == "basic":
        for task in tasks:
            run_job(task)
    elif kind == "processes":
        _in_processes(tasks, jobs_at_once(launcher, len(tasks)))
    else:
        from submitit import AutoExecutor

        executor = AutoExecutor(folder / ".submitit" / "%j", cluster=kind)
        executor.update_parameters(**{k: v for k, v in launcher.items() if k != "cluster"})
        for job in executor.map_array(run_job, tasks):
            job.results()


def jobs_at_once(launcher: Mapping[str, Any], jobs: int) -> int:
    """The number of jobs that share the cores of this machine."""
    n = {"processes": launcher.get("n_jobs"), "local": jobs}.get(kind_of(launcher)) or 1
    return min(jobs, n if n > 0 else max(1, cores() + 1 + n))


def _in_processes(tasks: Sequence[SweepTask], n: int) -> None:
    from loky import ProcessPoolExecutor

    pool = ProcessPoolExecutor(n, initializer=prepare_worker, initargs=(os.getpid(),))
    try:
        for future in [pool.submit(run_job, task) for task in tasks]:
            future.result()
    finally:
        pool.shutdown(kill_workers=True)


def run_job(task: SweepTask) -> None:
    """Runs a job. Its folder has the result or the error, which must not end the other jobs."""
    with tolerant_stderr(), as_ctrl_c("SIGTERM", "SIGHUP"):
        settings, target = read_settings(task.config), RunFolder(task.folder)
        runs = map(RunFolder, task.folders)
        if not settings.keep_going and any(each.error() for each in runs):
            return
        shown = settings.progress != "off"
        if shown:
            print(sweep_line(task), file=sys.stderr, flush=True)
        try:
            adapted = _adapted(settings, task)
            run_one(adapted, task.config, task.folder, home=task.home, command=task.command)
        except BusyError as error:  # another process has the folder, so nothing is written
            print(f"islandgp: {error}", file=sys.stderr)
        except Exception as error:
            if not target.error():  # the run ended before it could write the error
                target.fail(error)
        finally:
            if shown:
                print(job_line(target), file=sys.stderr, flush=True)


def _adapted(settings: Settings, task: SweepTask) -> Settings:
    """The settings, adapted to the launcher; the recorded configuration is unchanged."""
    changes: dict[str, Any] = {}
    if settings.resume == "never":
        changes["resume"] = "auto"  # the sweep has chosen its new folder
    if task.launcher in ("processes", "local"):  # their tables would be mixed
        changes["progress"] = "off"
    if task.workers and settings.evaluator.policy.get("workers") == 0:
        changes["evaluator"] = _with_policy(settings.evaluator, "workers", task.workers)
    if task.launcher in ("basic", "processes") and "patience" in settings.tracking.policy:
        # The job need not wait for its tracker, which goes on in the background.
        changes["tracking"] = _with_policy(settings.tracking, "patience", 0)
    return settings.model_copy(update=changes)


def _with_policy(part: ComponentConfig, key: str, value: int) -> ComponentConfig:
    return part.model_copy(update={"policy": {**part.policy, key: value}})


def sweep_line(task: SweepTask) -> str:
    """A line with the numbers of finished, running and failed jobs, and the time left.

    The job of the task counts as running, unless it is finished.
    """
    runs = [RunFolder(folder) for folder in task.folders]
    states = Counter(
        Status.RUNNING if run.path == task.folder and not run.finished() else run.status()
        for run in runs
    )
    generations = sum(run.completed_generations() for run in runs)
    line = (
        f"sweep {', '.join(dict.fromkeys(run.path.parent.name for run in runs))}:"
        f" {states[Status.FINISHED]} of {len(runs)} done, {states[Status.RUNNING]} running,"
        f" {states[Status.FAILED]} failed, generation {generations} of {task.generations}"
    )
    if generations == task.before:
        return line
    a_generation = (time() - task.started) / (generations - task.before)
    return f"{line}, {duration(a_generation * (task.generations - generations))} left"


def _unfinished(run: RunFolder) -> str:
    """Why a job has no result."""
    if run.status() is Status.RUNNING:
        return "another process is at work on it"
    reason = run.reason()
    return f"failed: {reason}" if reason else "stopped" if run.begun() else "not started"


def job_line(run: RunFolder) -> str:
    """The result of one job in a line."""
    if not run.finished():
        return f"{run.path.name}: {_unfinished(run)}"
    s = run.summary()
    tier, first = next(iter(s["first"].items()))  # the easiest milestone
    milestone = f"{title(tier)} {run.agent}"
    emerged = f"no {milestone}" if first is None else f"first {milestone} in generation {first}"
    mean = validation_mean(s)
    robot = "not validated" if mean is None else f"validation mean {in_points(mean)}"
    return f"{run.path.name}: {robot}, {emerged}, {duration(s['seconds'])}"


@dataclass(frozen=True, slots=True)
class _Job:
    """A job, and its entry in the file of its sweep."""

    planned: Planned
    entry: SweepJob

    @property
    def run(self) -> RunFolder:
        """The folder of its run."""
        return RunFolder(self.planned.folder.with_name(self.entry.folder))


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
    by_folder: dict[Path, list[SweepJob]] = {}
    for job in jobs:
        by_folder.setdefault(job.planned.folder.parent, []).append(job.entry)
    if runs := supervised_runs(job.settings for job in planned):
        from islandgp.supervision.llm.budget import costs  # only with a language model

        echo(costs(runs))
    interrupted = False
    with ExitStack() as stack:
        sweeps = [stack.enter_context(at_work(p, command, own)) for p, own in by_folder.items()]
        for sweep in sweeps:
            remove_leftovers(sweep.path, "sweep.json.*")
            if line := power_line(sweep):
                echo(line)
        try:
            _launch(jobs, home)
        except KeyboardInterrupt:
            interrupted = True
    try:
        _send(jobs, list(by_folder), home)
    except KeyboardInterrupt:
        interrupted = True
    for sweep in sweeps:
        echo(f"\n{arm_table(sweep)}\n\nResults: {sweep.path}")
        for names in identical_arms(sweep):
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
    return _Job(planned, entry)


def _must_differ(jobs: Sequence[Planned]) -> None:
    """Raises ConfigError if two jobs are the same run, or would share a folder."""
    seen: dict[Hashable, Planned] = {}
    for job in jobs:
        for key in (_frozen(identity_config(redacted(job.config))), job.folder):
            if (other := seen.setdefault(key, job)) is not job:
                names = " and ".join(dict.fromkeys([other.folder.name, job.folder.name]))
                raise ConfigError(
                    "Expected jobs that differ, each in a folder of its own, found two that are the"
                    f" same run or in the same folder: {names}; take one of them out of the sweep,"
                    " or give each of them another name=..."
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
        launch(tasks, launcher, jobs[0].planned.folder.parent)
    except IslandError:
        raise
    except Exception as error:
        if existed == [run.begun() for run in runs] and not all(existed):
            raise RunError(
                "Expected the launcher to start the jobs, found that it cannot:"
                f" {brief(error)}; change hydra.launcher, or choose another hydra/launcher."
            ) from None
        print(f"islandgp: the launcher failed ({brief(error)})", file=sys.stderr)


def _send(jobs: Sequence[_Job], folders: Sequence[Path], home: Path) -> None:
    """Sends the final states of the jobs and of the sweep to the tracking store."""
    from islandgp.tracking.mlflow import MLflow, send_sweeps

    parts = [job.planned.settings.tracking for job in jobs]
    trackers = [MLflow.make(p.settings(), home) for p in parts if p.factory is MLflow]
    if trackers and (message := send_sweeps(folders, trackers)):
        print(message, file=sys.stderr)


def _report(jobs: Sequence[_Job]) -> int:
    """Lists the jobs that are not finished, or got too many fallbacks; returns the exit code."""
    if bad := [job for job in jobs if not job.run.finished()]:
        print(f"\n{len(bad)} of {len(jobs)} jobs not finished:", file=sys.stderr)
        for job in bad:
            run = job.run
            print(f"\n  {run.path.name}: {_unfinished(run)}", file=sys.stderr)
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
