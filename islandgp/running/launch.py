"""Starts the jobs of a sweep: one after the other, in processes of this machine, or by Slurm.

Hydra's launchers are not used, as each job is composed and checked already. The result of a job is
read from its folder, so it is known with any launcher, and also if its process died.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import time
from typing import Any, Final

from islandgp.config.settings import Settings, read_settings
from islandgp.errors import BusyError, ConfigError
from islandgp.evaluation.processes import cores, prepare_worker
from islandgp.plugin import ComponentConfig
from islandgp.records.folder import RunFolder, Status
from islandgp.records.values import validation_mean
from islandgp.running.console import as_ctrl_c, tolerant_stderr
from islandgp.running.progress import duration
from islandgp.running.run import run
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
            run(adapted, task.config, task.folder, home=task.home, command=task.command)
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


def job_line(run: RunFolder) -> str:
    """The result of one job in a line."""
    if not run.finished():
        if run.status() is Status.RUNNING:
            return f"{run.path.name}: another process is at work on it"
        reason = run.reason()
        return f"{run.path.name}: {f'failed: {reason}' if reason else 'stopped'}"
    s = run.summary()
    tier, first = next(iter(s["first"].items()))  # the easiest milestone
    milestone = f"{title(tier)} {run.agent}"
    emerged = f"no {milestone}" if first is None else f"first {milestone} in generation {first}"
    mean = validation_mean(s)
    robot = "not validated" if mean is None else f"validation mean {in_points(mean)}"
    return f"{run.path.name}: {robot}, {emerged}, {duration(s['seconds'])}"
