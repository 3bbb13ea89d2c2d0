"""The MLflow run of a whole sweep: parent of its jobs, with their mean curves and a summary."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from filelock import FileLock

from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import flat
from islandgp.sweep.folder import SweepFile, SweepFolder
from islandgp.sweep.summary import ArmSummary, arm_table, arms, sweep_note
from islandgp.tracking.store import ARM, LOCK, SENT, Store, metric, run_key, valid_names

CURVES: Final = "islandgp.curves"  # tag with the digest of the jobs in the curves
MAX_ARM: Final = 180  # characters of an arm's name in a metric name, which MLflow limits to 250


def parent_run(folder: Path, store: Store) -> str | None:
    """The parent of the run in `folder`, created if missing; None if it is not a sweep's job."""
    sweep = SweepFolder(folder.parent)
    file = sweep.read()
    if file is None or folder.name not in {job.folder for job in file.jobs}:
        return None
    with FileLock(sweep.path / LOCK):
        run = store.find(file.id)
        if run is None:
            return _create(sweep, file, store)
        if run.info.status != Status.RUNNING and sweep.at_work():
            store.client.update_run(run.info.run_id, status=Status.RUNNING)
        return str(run.info.run_id)


def send_sweep(sweep: SweepFolder, store: Store, status: Status) -> str | None:
    """Sends the sweep's curves and summary; returns the parent's id.

    All jobs must have been sent before. Errors of MLflow propagate.
    """
    file = sweep.read()
    if file is None:
        return None
    summaries = arms(sweep, file)
    key = _digest(summaries)
    done = f"{status} {key}"
    with FileLock(sweep.path / LOCK):
        found = store.find(file.id)
        run = _create(sweep, file, store) if found is None else str(found.info.run_id)
        tags = {} if found is None else found.data.tags
        is_sent = found is not None and (found.info.status, tags.get(SENT)) == (status, done)
        if status is Status.RUNNING or is_sent:
            return run
        if tags.get(CURVES, key) != key:  # its curves are of other jobs, and cannot be deleted
            store.client.delete_run(run)
            run = _create(sweep, file, store)
        end_ms = _end_time(sweep, file)
        client = store.client
        client.set_terminated(run, status, end_ms)
        if status is Status.FINISHED:
            client.set_tag(run, CURVES, key)
            curves = [metric(name, value, end_ms, step) for name, value, step in _curves(summaries)]
            store.log_metrics(run, curves)
            store.log_parameters(run, _parameters(sweep, file))
        client.set_tag(run, "mlflow.note.content", sweep_note(sweep, file, summaries, status))
        client.log_text(run, arm_table(summaries), "arms.md")
        client.log_artifact(run, str(sweep.path / "sweep.json"))
        for job in file.jobs:
            about = sweep.run(job).about()
            child = None if about is None else store.find(run_key(about))
            if child is not None:
                client.set_tag(child.info.run_id, "mlflow.parentRunId", run)
                for name, value in {ARM: file.arm(job), **file.tags(job)}.items():
                    client.set_tag(child.info.run_id, name, value)
        client.set_tag(run, SENT, done)
        return run


def _create(sweep: SweepFolder, file: SweepFile, store: Store) -> str:
    name, command = sweep.path.name, file.commands[-1]
    tags = {"kind": "sweep", "sweep": name, "mlflow.note.content": f"`{command}`"}
    return store.create(file.id, f"sweep {name}", command=command, started=file.started, tags=tags)


def _digest(arms: list[ArmSummary]) -> str:
    """Identity of the runs in the curves; "" if there are none."""
    names = sorted(run.folder for arm in arms for run in arm.finished)
    return hashlib.sha256("\n".join(names).encode()).hexdigest()[:12] if names else ""


def _parameters(sweep: SweepFolder, file: SweepFile) -> Iterator[tuple[str, str]]:
    """The configuration of the sweep: the value of each key, or its values in the jobs' order."""
    values: dict[str, dict[str, None]] = {}
    for job in file.jobs:
        config = RunFolder(sweep.path / job.folder).configuration()
        for key, value in flat({**config, "seed": job.seed}):
            values.setdefault(key, {})[value] = None
    return ((key, ", ".join(texts)) for key, texts in values.items())


def _curves(arms: list[ArmSummary]) -> Iterator[tuple[str, float, int]]:
    """Means and standard deviations over the seeds: metric, value, generation."""
    for arm, name in zip(arms, metric_names([arm.name for arm in arms]), strict=True):
        for curve in arm.curves:
            for step, mean in enumerate(curve.means):
                yield f"sweep/{name} {curve.name} mean", mean, step
            for step, sd in enumerate(curve.deviations):  # a single run has none
                yield f"sweep/{name} {curve.name} sd", sd, step


def _end_time(sweep: SweepFolder, file: SweepFile) -> int:
    """Time of the last recorded generation of any job, ms since 1970."""
    records = (sweep.path / job.folder / "generations.jsonl" for job in file.jobs)
    times = [int(1000 * path.stat().st_mtime) for path in records if path.exists()]
    return max(times, default=file.started)


def metric_names(arms: Sequence[str]) -> list[str]:
    """Names of the arms as a part of metrics: unique, of at most MAX_ARM characters."""
    return valid_names(arms, re.compile(r"[^\w. -]"), MAX_ARM)
