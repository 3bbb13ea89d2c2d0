"""One job of a sweep, in the process started by a launcher."""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from islandgp.config.compose import read
from islandgp.config.naming import is_choice, run_folder
from islandgp.config.settings import Settings
from islandgp.errors import BusyError
from islandgp.evaluation.processes import cores
from islandgp.plugin import ComponentConfig
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import without_credentials
from islandgp.running.printing import tolerant_stderr
from islandgp.running.run import run
from islandgp.sweep.folder import SweepJob
from islandgp.sweep.progress import SweepStart, job_line, sweep_line

SEPARATE_OUTPUT: Final = frozenset({"BasicLauncher", "SlurmLauncher"})
"""Launchers whose jobs have their own terminal or log."""

SHARED_PROCESS: Final = frozenset({"BasicLauncher", "JoblibLauncher"})
"""Launchers whose processes run several jobs."""


class Forget(Callback):
    """Frees the configurations of finished jobs, which Hydra keeps: 0.4 MiB per job."""

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **_: Any) -> None:  # noqa: ARG002 -- as in Hydra
        """See `Callback`."""
        job_return.cfg = job_return.hydra_cfg = None


def sweep_job(start: SweepStart) -> Callable[[DictConfig], None]:
    """The function that Hydra calls for each job.

    It does not raise an exception if a job fails, as some launchers would end the other jobs. The
    job's folder has its result or its error.
    """

    def job(config: DictConfig) -> None:
        # joblib's workers set their own start method as the default, with which
        # the evaluator's processes cannot start.
        multiprocessing.set_start_method(None, force=True)
        plain, settings = read(config)
        hydra = HydraConfig.get()
        home = Path(hydra.runtime.cwd)
        named = run_folder(plain, list(hydra.overrides.task), home)
        with tolerant_stderr():  # a separate process does not inherit the command's
            target = start.run(named)
            if not settings.keep_going and any(map(start.failed, start.runs())):
                return
            fitted_settings = fitted(settings, hydra.launcher, len(start.jobs))
            attempt(target, plain, fitted_settings, home, start.jobs[named].command, start)

    return job


def attempt(
    target: RunFolder,
    config: dict[str, Any],
    settings: Settings,
    home: Path,
    command: str,
    start: SweepStart,
) -> None:
    """Runs a job of a sweep. Its folder has the result or the error.

    Args:
        target: folder of the job.
        config: resolved, as plain values.
        settings: of the configuration, adapted to the launcher.
        home: working folder of the command.
        command: that runs this job alone.
        start: state of the sweep at its start.
    """
    alone = settings.progress != "off"
    if alone:
        print(sweep_line(start, target), file=sys.stderr, flush=True)
    try:
        run(settings, config, target.path, home=home, command=command)
    except BusyError as error:  # another process has the folder, so nothing is written
        print(f"islandgp: {error}", file=sys.stderr)
    except Exception as error:  # must not end the other jobs
        if not target.error():  # the run ended before it could write the error
            target.fail(error)
    finally:
        if alone:
            print(job_line(target), file=sys.stderr, flush=True)


def sweep_entry(
    config: Mapping[str, Any],
    overrides: Sequence[str],
    named: Path,
    folder: Path,
    command: str,
) -> SweepJob:
    """The entry of a job in sweep.json.

    `config` and `overrides` are the job's, which name one folder, and it may run in another.
    """
    return SweepJob(
        slot=named.name,
        folder=folder.name,
        supervisor=str(config["supervisor"]["name"]),
        seed=int(config["seed"]),
        choices=tuple(without_credentials(o) for o in overrides if is_choice(o)),
        generations=int(config["gp"]["generations"]),
        command=command,
    )


def fitted(settings: Settings, launcher: Mapping[str, Any], jobs: int) -> Settings:
    """The settings of a job, adapted to the launcher; the recorded configuration is unchanged."""
    kind = str(launcher["_target_"]).rpartition(".")[2]
    changes: dict[str, Any] = {}
    if settings.resume == "never":
        changes["resume"] = "auto"  # the sweep has chosen its new folder
    if kind not in SEPARATE_OUTPUT:
        changes["progress"] = "off"  # the launching process shows it
    if (workers := workers_of(launcher, jobs)) and settings.evaluator.policy.get("workers") == 0:
        changes["evaluator"] = _with_policy(settings.evaluator, "workers", workers)
    if kind in SHARED_PROCESS and "patience" in settings.tracking.policy:
        # The job need not wait for its tracker, which goes on in the background.
        changes["tracking"] = _with_policy(settings.tracking, "patience", 0)
    return settings.model_copy(update=changes)


def _with_policy(part: ComponentConfig, key: str, value: int) -> ComponentConfig:
    return part.model_copy(update={"policy": {**part.policy, key: value}})


def workers_of(launcher: Mapping[str, Any], jobs: int) -> int:
    """Number of cores for a job with a launcher of parallel jobs; 0: all."""
    kind = str(launcher["_target_"]).rpartition(".")[2]
    if kind == "JoblibLauncher":
        n = launcher["n_jobs"] or 1
        at_once = min(jobs, n if n > 0 else max(1, cores() + 1 + n))
        return max(1, cores() // at_once)
    if kind == "LocalLauncher":  # submitit's, for trying it out
        return max(1, cores() // jobs)
    return 0
