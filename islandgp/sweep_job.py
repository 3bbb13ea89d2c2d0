"""One job of a sweep, in whatever process a launcher chose for it."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from islandgp.compose import read, run_folder
from islandgp.evaluation.processes import cores
from islandgp.run import run
from islandgp.settings import Settings
from islandgp.sweep_progress import Start, job_line, sweep_line, written_since


def sweep_job(start: Start) -> Callable[[DictConfig], None]:
    """The function that Hydra calls for each job.

    It never raises because a job failed: an exception would end the other jobs
    with some launchers. The job's folder tells what happened.
    """

    def job(config: DictConfig) -> None:
        # joblib's workers leave a start method of their own as the default, with which
        # the evaluator's processes cannot start.
        multiprocessing.set_start_method(None, force=True)
        plain, settings = read(config)
        hydra = HydraConfig.get()
        home = Path(hydra.runtime.cwd)
        named = run_folder(settings, list(hydra.overrides.task), home)
        at_once = jobs_at_once(hydra.launcher, len(start.jobs))
        _run(plain, _fitted(settings, at_once), start, named, home)

    return job


def _run(config: dict[str, Any], settings: Settings, start: Start, named: Path, home: Path) -> None:
    target, job = start.run(named), start.jobs[named]
    if written_since(target, start.at):
        return  # it failed in this sweep before a launcher broke down
    alone = settings.progress != "off"
    if alone:
        print(sweep_line(start), file=sys.stderr, flush=True)
    try:
        run(settings, config, target.path, home=home, command=job.command, keep_display=False)
    except Exception as error:  # whatever it is, it must not end the other jobs
        if not target.error():  # the run came too short to write it down itself
            target.fail(error)
    if alone:
        print(job_line(target), file=sys.stderr, flush=True)


def _fitted(settings: Settings, at_once: int) -> Settings:
    """The settings of a job among several at a time.

    Each gets its share of the cores, and only the launching process shows progress.
    The configuration that is recorded stays what the user wrote.
    """
    changes: dict[str, Any] = {}
    if settings.resume == "never":
        changes["resume"] = "auto"  # the sweep has chosen its new folder
    if at_once > 1:
        changes["progress"] = "off"
        policy = settings.evaluator.policy
        if policy.get("workers") == 0:
            share = {**policy, "workers": max(1, cores() // at_once)}
            changes["evaluator"] = settings.evaluator.model_copy(update={"policy": share})
    return settings.model_copy(update=changes)


def jobs_at_once(launcher: Mapping[str, Any], jobs: int) -> int:
    """How many jobs a launcher runs on one machine at a time, as far as its settings tell."""
    kind = str(launcher["_target_"]).rpartition(".")[2]
    if kind == "JoblibLauncher":
        n = launcher["n_jobs"] or 1
        return min(jobs, n if n > 0 else max(1, cores() + 1 + n))
    if kind == "RayLauncher":
        needs = float(launcher["ray"].get("remote", {}).get("num_cpus", 1)) or 1.0
        return max(2, min(jobs, int(cores() / needs)))
    if kind == "LocalLauncher":  # submitit's, for trying it out
        return jobs
    return 1
