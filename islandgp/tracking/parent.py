"""The MLflow run of a whole sweep: parent of its jobs, with a summary by arm.

MLflow itself draws the mean curve of an arm, if its pages are grouped by arms, as `ui` does.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from filelock import FileLock

from islandgp.records.folder import Status
from islandgp.sweep.folder import SweepFile, SweepFolder
from islandgp.sweep.summary import ArmSummary, arm_table, arms, sweep_note
from islandgp.tracking.store import ARM, LOCK, SENT, Store, run_key


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
    """Sends the sweep's summary; returns the parent's id.

    All jobs must have been sent before. Errors of MLflow propagate.
    """
    file = sweep.read()
    if file is None:
        return None
    summaries = arms(sweep, file)
    done = f"{status} {_digest(summaries)}"
    with FileLock(sweep.path / LOCK):
        found = store.find(file.id)
        run = _create(sweep, file, store) if found is None else str(found.info.run_id)
        tags = {} if found is None else found.data.tags
        is_sent = found is not None and (found.info.status, tags.get(SENT)) == (status, done)
        if status is Status.RUNNING or is_sent:
            return run
        client = store.client
        client.set_terminated(run, status, _end_time(sweep, file))
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
    """Identity of the finished runs; "" if there are none."""
    names = sorted(run.folder for arm in arms for run in arm.finished)
    return hashlib.sha256("\n".join(names).encode()).hexdigest()[:12] if names else ""


def _end_time(sweep: SweepFolder, file: SweepFile) -> int:
    """Time of the last recorded generation of any job, ms since 1970."""
    records = (sweep.path / job.folder / "generations.jsonl" for job in file.jobs)
    times = [int(1000 * path.stat().st_mtime) for path in records if path.exists()]
    return max(times, default=file.started)
