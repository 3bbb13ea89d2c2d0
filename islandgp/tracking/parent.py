"""The MLflow run of a whole sweep: parent of its jobs, with their mean curves and a summary."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from filelock import FileLock

from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import flat
from islandgp.sweep.folder import SweepFile, SweepFolder
from islandgp.tracking.store import ARM, Store, metric, valid_names
from islandgp.tracking.summary import ArmSummary, arm_table, arms, sweep_note
from islandgp.tracking.sync_state import LOCK, SyncState, read_state, write_state

MAX_ARM: Final = 180  # characters of an arm's name in a metric name, which MLflow limits to 250


def parent_run(folder: Path, store: Store) -> str | None:
    """The parent of the run in `folder`, created if missing; None if it is not a sweep's job."""
    sweep = SweepFolder(folder.parent)
    file = sweep.read()
    if file is None or folder.name not in {job.folder for job in file.jobs}:
        return None
    with FileLock(sweep.path / LOCK):
        state = _parent(sweep, file, store)
        if state.done and sweep.at_work():
            store.client.update_run(state.run, status=Status.RUNNING)
            write_state(sweep.path, replace(state, done=""))
        return state.run


def send_sweep(sweep: SweepFolder, store: Store, status: Status) -> str | None:
    """Sends the sweep's curves and summary; returns the parent's id.

    All jobs must have been sent before. Errors of MLflow propagate.
    """
    file = sweep.read()
    if file is None:
        return None
    summaries = arms(sweep, file)
    key = _digest(summaries)
    with FileLock(sweep.path / LOCK):
        state = _parent(sweep, file, store)
        if status is Status.RUNNING or state.done == f"{status} {key}":
            return state.run
        if state.identity not in ("", key):  # its curves are of other jobs, and cannot be deleted
            store.client.delete_run(state.run)
            state = _create(sweep, file, store)
            write_state(sweep.path, state)
        end_ms = _end_time(sweep, file)
        store.client.set_terminated(state.run, status, end_ms)
        if status is Status.FINISHED and state.identity != key:
            curves = [metric(name, value, end_ms, step) for name, value, step in _curves(summaries)]
            store.log_metrics(state.run, curves)
            store.log_parameters(state.run, _parameters(sweep, file))
            state = replace(state, identity=key)
        client = store.client
        client.set_tag(state.run, "mlflow.note.content", sweep_note(sweep, file, summaries, status))
        client.log_text(state.run, arm_table(summaries), "arms.md")
        client.log_artifact(state.run, str(sweep.path / "sweep.json"))
        for job in file.jobs:
            child = read_state(sweep.path / job.folder)
            if child is not None and child.uri == state.uri:
                store.client.set_tag(child.run, "mlflow.parentRunId", state.run)
                store.client.set_tag(child.run, ARM, file.arm(job))
        write_state(sweep.path, replace(state, done=f"{status} {key}"))
        return state.run


def _parent(sweep: SweepFolder, file: SweepFile, store: Store) -> SyncState:
    state, place = read_state(sweep.path), store.place
    if state is None or not state.is_in(place, state.identity):
        state = SyncState(place.uri, place.experiment, "", "")
    run = store.find(file.id, state.run)
    if run is None:
        state = _create(sweep, file, store)
    elif run.info.run_id != state.run:
        state = SyncState(place.uri, place.experiment, "", str(run.info.run_id))
    write_state(sweep.path, state)
    return state


def _create(sweep: SweepFolder, file: SweepFile, store: Store) -> SyncState:
    name, command = sweep.path.name, file.commands[-1]
    tags = {"kind": "sweep", "sweep": name, "mlflow.note.content": f"`{command}`"}
    run = store.create(file.id, f"sweep {name}", command=command, started=file.started, tags=tags)
    return SyncState(store.place.uri, store.place.experiment, "", run)


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
