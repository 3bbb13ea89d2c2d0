"""A sweep: checks and records its jobs, launches them, and reports their results at the end."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from islandgp.atomic_files import remove_leftovers
from islandgp.config.compose import Planned, is_choice
from islandgp.config.settings import Settings
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


def launch(
    work: Callable[[Planned], None], jobs: Sequence[Planned], launcher: Mapping[str, Any]
) -> None:
    """Does the work of each job and waits; the files of Slurm's jobs are beside the runs.

    Raises:
        Exception: of the launcher; those of a job are in its folder.
    """
    kind = kind_of(launcher)
    if kind == "basic":
        for job in jobs:
            work(job)
    elif kind == "processes":
        _in_processes(work, jobs, jobs_at_once(launcher, len(jobs)))
    else:
        from submitit import AutoExecutor

        executor = AutoExecutor(jobs[0].folder.parent / ".submitit" / "%j", cluster=kind)
        executor.update_parameters(**{k: v for k, v in launcher.items() if k != "cluster"})
        for started in executor.map_array(work, jobs):
            started.results()


def jobs_at_once(launcher: Mapping[str, Any], jobs: int) -> int:
    """The number of jobs that share the cores of this machine."""
    n = {"processes": launcher.get("n_jobs"), "local": jobs}.get(kind_of(launcher)) or 1
    return min(jobs, n if n > 0 else max(1, cores() + 1 + n))


def _in_processes(work: Callable[[Planned], None], jobs: Sequence[Planned], n: int) -> None:
    from loky import ProcessPoolExecutor

    pool = ProcessPoolExecutor(n, initializer=prepare_worker, initargs=(os.getpid(),))
    try:
        for future in [pool.submit(work, job) for job in jobs]:
            future.result()
    finally:
        pool.shutdown(kill_workers=True)


def run_job(job: Planned, *, home: Path, folders: Sequence[Path], workers: int) -> None:
    """Runs a job. Its folder has the result or the error, which must not end the other jobs.

    Args:
        job: with the folder that was chosen for it.
        home: working folder of the sweep's command.
        folders: of all jobs.
        workers: processes of an evaluator that leaves their number open; 0: all cores.
    """
    with tolerant_stderr(), as_ctrl_c("SIGTERM", "SIGHUP"):
        run = RunFolder(job.folder)
        if not job.settings.keep_going and any(RunFolder(each).error() for each in folders):
            return
        try:
            adapted = _adapted(job, workers)
            run_one(adapted, job.config, job.folder, home=home, command=job.command)
        except BusyError as error:  # another process has the folder, so nothing is written
            print(f"islandgp: {error}", file=sys.stderr)
        except Exception as error:
            if not run.error():  # the run ended before it could write the error
                run.fail(error)
        finally:
            if job.settings.progress != "off":
                done = sum(RunFolder(each).finished() for each in folders)
                line = f"{done} of {len(folders)} jobs done: {job_line(run)}"
                print(line, file=sys.stderr, flush=True)


def _adapted(job: Planned, workers: int) -> Settings:
    """The job's settings, adapted to its launcher; the recorded configuration is unchanged."""
    settings, kind = job.settings, kind_of(job.launcher)
    changes: dict[str, Any] = {}
    if settings.resume == "never":
        changes["resume"] = "auto"  # the sweep has chosen its new folder
    if kind in ("processes", "local"):  # their tables would be mixed
        changes["progress"] = "off"
    if workers and settings.evaluator.policy.get("workers") == 0:
        changes["evaluator"] = _with_policy(settings.evaluator, "workers", workers)
    if kind in ("basic", "processes") and "patience" in settings.tracking.policy:
        # The job need not wait for its tracker, which goes on in the background.
        changes["tracking"] = _with_policy(settings.tracking, "patience", 0)
    return settings.model_copy(update=changes)


def _with_policy(part: ComponentConfig, key: str, value: int) -> ComponentConfig:
    return part.model_copy(update={"policy": {**part.policy, key: value}})


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
    jobs, by_folder = list[Planned](), dict[Path, list[SweepJob]]()
    for each in planned:
        entry = _entry(each)
        by_folder.setdefault(each.folder.parent, []).append(entry)
        jobs.append(replace(each, folder=each.folder.with_name(entry.folder)))
    if runs := supervised_runs(job.settings for job in jobs):
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


def _entry(job: Planned) -> SweepJob:
    """The job in the file of its sweep, with the folder of its run."""
    config = job.config
    return SweepJob(
        slot=job.folder.name,
        folder=choose(RunFolder(job.folder), job.settings, redacted(config)).path.name,
        supervisor=str(config["supervisor"]["name"]),
        seed=int(config["seed"]),
        choices=tuple(without_credentials(o) for o in job.overrides if is_choice(o)),
        command=job.command,
    )


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


def _launch(jobs: Sequence[Planned], home: Path) -> None:
    """Launches the jobs. Raises RunError if the launcher has not started any job."""
    runs, launcher = [RunFolder(job.folder) for job in jobs], jobs[0].launcher
    for run in runs:
        (run.path / "error.txt").unlink(missing_ok=True)
    at_once = jobs_at_once(launcher, len(jobs))
    work = partial(
        run_job,
        home=home,
        folders=[run.path for run in runs],
        workers=max(1, cores() // at_once) if at_once > 1 else 0,
    )
    existed = [run.begun() for run in runs]
    try:
        launch(work, jobs, launcher)
    except IslandError:
        raise
    except Exception as error:
        if existed == [run.begun() for run in runs] and not all(existed):
            raise RunError(
                "Expected the launcher to start the jobs, found that it cannot:"
                f" {brief(error)}; change hydra.launcher, or choose another hydra/launcher."
            ) from None
        print(f"islandgp: the launcher failed ({brief(error)})", file=sys.stderr)


def _send(jobs: Sequence[Planned], folders: Sequence[Path], home: Path) -> None:
    """Sends the final states of the jobs and of the sweep to the tracking store."""
    from islandgp.tracking.mlflow import MLflow, send_sweeps

    parts = [job.settings.tracking for job in jobs]
    trackers = [MLflow.make(p.settings(), home) for p in parts if p.factory is MLflow]
    if trackers and (message := send_sweeps(folders, trackers)):
        print(message, file=sys.stderr)


def _report(jobs: Sequence[Planned]) -> int:
    """Lists the jobs that are not finished, or got too many fallbacks; returns the exit code."""
    runs = [RunFolder(job.folder) for job in jobs]
    if bad := [(job, run) for job, run in zip(jobs, runs, strict=True) if not run.finished()]:
        print(f"\n{len(bad)} of {len(jobs)} jobs not finished:", file=sys.stderr)
        for job, run in bad:
            print(f"\n  {run.path.name}: {_unfinished(run)}", file=sys.stderr)
            if run.error():
                print(f"    error:  {run.path / 'error.txt'}", file=sys.stderr)
            print(f"    again:  {job.command}", file=sys.stderr)
        return 1
    if mostly := [run.path.name for run in runs if is_mostly_fallback(run.summary())]:
        print(
            f"\nislandgp: in {len(mostly)} of {len(jobs)} jobs {MOSTLY_FALLBACK}", file=sys.stderr
        )
        print("\n".join(f"  {name}" for name in mostly), file=sys.stderr)
        return 3
    return 0
