"""Sends the missing parts of a run's folder to MLflow.

Used by the tracker of a run and by `islandgp sync`. It is idempotent: a run is found by its key,
points are sent from the last step in the store on, and their times are read from the folder, so
that MLflow recognises a repeated point. A tag of the MLflow run says when everything was sent.

A sweep is the parent of its jobs, with a summary by arm. MLflow itself draws the mean curve of an
arm, if its pages are grouped by arms, as `ui` does.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Final

from filelock import FileLock

from islandgp.bt.core.language import parse
from islandgp.bt.export.render import to_svg
from islandgp.errors import RunError, TrackingError
from islandgp.gate import check_folder, read_text
from islandgp.records.files import LONG, PAGE, RunMetadata
from islandgp.records.folder import RunFolder, Status
from islandgp.records.manifest import NAME as MANIFEST
from islandgp.records.manifest import REQUIRED
from islandgp.records.parameters import flat
from islandgp.records.sweep import Sweep, arm_of, arm_table, job_of, sweep_note
from islandgp.records.values import generation_values, metric_values, run_values, sentences
from islandgp.scoring.constraints import recorded_constraints
from islandgp.tracking.store import ARM, LOCK, SENT, Store, points
from islandgp.viewer.run_page import write_page

MARKER_METRIC: Final = "fitness_max"  # a metric that every generation has
MAX_POINTS: Final = 1000  # MLflow's limit of points a call

FILES: Final = (*REQUIRED, LONG, MANIFEST, PAGE, "transcript.jsonl")
"""Files of the folder that are sent unchanged. Without error.txt, whose content is in the note:
MLflow cannot delete a file, and a failed run may be resumed."""


@dataclass(frozen=True, slots=True)
class RunUploader:
    """Sends one run's folder to an MLflow run: metrics, parameters, tags and artifacts."""

    folder: RunFolder
    store: Store
    alive: Callable[[], object] = lambda: None  # called whenever records were sent
    has_own_page: bool = False  # else the page is written again before it is sent

    def send(self, status: Status) -> tuple[str, bool]:
        """Sends everything missing. Errors of MLflow propagate.

        Returns:
            The MLflow run's id, and whether anything was missing.

        Raises:
            TrackingError: no run was started in the folder.
            IslandError: the run is damaged.
        """
        folder, store = self.folder, self.store
        if (about := folder.about()) is None:
            raise TrackingError(f"Expected a run's folder, found no about.json in {folder.path}.")
        if status is Status.FINISHED and folder.finished():
            folder.must_be_sound()
        with FileLock(folder.path / LOCK):
            done, stored = f"{status} {folder.completed_generations()}", store.find(about.id)
            before = None if stored is None else (stored.info.status, stored.data.tags.get(SENT))
            run = self._create(about) if stored is None else str(stored.info.run_id)
            if before == (status, done):
                return run, False
            if before and status is Status.RUNNING and before[0] != status:
                parent_run(folder.path, store)
                store.client.update_run(run, status=status)
            first = store.last_step(run, MARKER_METRIC) + 1
            if not first:  # else parameters were sent before the first point
                store.log_parameters(run, flat(folder.configuration()))
            self.alive()
            end = self._send_generations(run, first)
            if status is not Status.RUNNING:
                self._end(run, about, status, end - 1)
                store.client.set_tag(run, SENT, done)
            return run, True

    def _create(self, about: RunMetadata) -> str:
        """Creates the MLflow run; another one of the same job, whose folder was deleted, goes."""
        parent = parent_run(self.folder.path, self.store)
        arm = arm_of(self.folder.path) or about.tags.get("arm", "")
        tags = {**about.tags, ARM: levels_first(arm)}
        tags |= {"mlflow.parentRunId": parent} if parent else {}
        run = self.store.create(
            about.id, about.title, command=about.command, started=about.started, tags=tags
        )
        if parent:
            self.store.delete_children(parent, about.title, without=run)
        return run

    def _send_generations(self, run: str, first: int) -> int:
        """Sends the points from a generation on, as many in a call as MLflow accepts.

        Returns the number of generations that the store has.
        """
        end = max(first, self.folder.completed_generations())
        records, costs = self.folder.records(first), self.folder.costs(first)
        pairs = zip(islice(records, end - first), islice(costs, end - first), strict=True)
        constraints = recorded_constraints(self.folder.configuration())
        waiting = [
            points(metric_values(generation_values(record, cost, constraints)), cost["at"], step)
            for step, (record, cost) in enumerate(pairs, first)
        ]
        size = max(1, MAX_POINTS // max(map(len, waiting), default=1))  # generations in a call
        for at in range(0, len(waiting), size):
            batch = [*chain.from_iterable(waiting[at : at + size])]
            self.store.client.log_batch(run, metrics=batch)
            self.alive()
        return end

    def _end(self, run: str, about: RunMetadata, status: Status, last: int) -> None:
        """Sends the end of a run; `last` is the step of its last point."""
        has_page, client = self.has_own_page, self.store.client
        if not has_page:
            with suppress(RunError):  # the records are sent without it
                write_page(self.folder, status)
                has_page = True
        end_time = max((int(cost["at"]) for cost in self.folder.costs()), default=about.started)
        # First, so that it is not RUNNING if anything below fails.
        client.set_terminated(run, status, end_time)
        with tempfile.TemporaryDirectory(prefix="islandgp-") as copies:
            copy_artifacts(self.folder.path, Path(copies), has_page=has_page)
            client.log_artifacts(run, copies)
        self.alive()
        client.set_tag(run, "mlflow.note.content", note(self.folder, about, status))
        # Points cannot be deleted, and a stopped run may be resumed.
        if status is Status.FINISHED and self.folder.finished():
            figures = metric_values(run_values(self.folder.summary()))
            numbers = {f"run/{name}": value for name, value in figures.items()}
            client.log_batch(run, metrics=points(numbers, end_time, last))


def copy_artifacts(run: Path, copies: Path, *, has_page: bool = True) -> None:
    """Copies the files of a run that has ended, and its best tree as MLflow's pages show it.

    `has_page`: this process has written the page; a page of others, which may hold any script, is
    left out.
    """
    check_folder(run)
    for name in FILES:
        if (run / name).exists() and (has_page or name != PAGE):
            shutil.copyfile(run / name, copies / name)
    if (best := run / "best.bt").exists():
        text = read_text(best)
        (copies / "best.bt.txt").write_text(text, encoding="utf-8")
        (copies / "best.svg").write_text(to_svg(parse(text)), encoding="utf-8")


def note(folder: RunFolder, about: RunMetadata, status: Status) -> str:
    """The run's description in MLflow, in Markdown."""
    lines = [f"**{about.title}** ({status.value.lower()})", ""]
    if folder.finished():
        summary = folder.summary()
        lines += [f"- {line}" for line in sentences(summary)]
        lines += ["", "```", summary["champion"]["text"].rstrip(), "```"]
    elif error := folder.error():
        lines += ["```", error.strip()[-3000:], "```"]
    lines += ["", f"`{about.command}`", "", f"Records: `{folder.path}`"]
    return "\n".join(lines)


def parent_run(folder: Path, store: Store) -> str | None:
    """The parent of the run in `folder`, created if missing; None if it is not a sweep's job."""
    if (found := job_of(folder)) is None:
        return None
    sweep, _ = found
    with FileLock(sweep.path / LOCK):
        run, status, _ = _parent(sweep, store)
        if status != Status.RUNNING and sweep.at_work():
            store.client.update_run(run, status=Status.RUNNING)
        return run


def send_sweep(sweep: Sweep, store: Store, status: Status) -> None:
    """Sends the sweep's summary, if it has changed.

    All jobs must have been sent before. Errors of MLflow propagate.
    """
    finished = sorted(job.folder for job in sweep.jobs if sweep.run(job).finished())
    digest = hashlib.sha256("\n".join(finished).encode()).hexdigest()[:12] if finished else ""
    done = f"{status} {digest}"
    with FileLock(sweep.path / LOCK):
        run, before, sent = _parent(sweep, store)
        if status is Status.RUNNING or (before, sent) == (status, done):
            return
        client, table = store.client, arm_table(sweep)
        records = (sweep.path / job.folder / "generations.jsonl" for job in sweep.jobs)
        times = [int(1000 * path.stat().st_mtime) for path in records if path.exists()]
        client.set_terminated(run, status, max(times, default=sweep.started))
        client.set_tag(run, "mlflow.note.content", sweep_note(sweep, table))
        client.log_text(run, table, "arms.txt")
        client.log_artifact(run, str(sweep.path / "sweep.json"))
        for job in sweep.jobs:
            about = sweep.run(job).about()
            child = None if about is None else store.find(about.id)
            if child is not None:
                tags = {
                    ARM: levels_first(sweep.arm(job)),
                    **sweep.tags(job),
                    "mlflow.parentRunId": run,
                }
                for name, value in tags.items():
                    client.set_tag(child.info.run_id, name, value)
        client.set_tag(run, SENT, done)


def levels_first(arm: str) -> str:
    """An arm's name, levels before the names of factors: MLflow shows its first ten letters."""
    pairs = [(name, level) for name, _, level in (word.partition("=") for word in arm.split(" "))]
    names = ", ".join(name for name, level in pairs if level)
    levels = " ".join(level or name for name, level in pairs)
    return f"{levels} ({names})" if names else levels


def _parent(sweep: Sweep, store: Store) -> tuple[str, str, str | None]:
    """Id, status and tag SENT of a sweep's MLflow run, created if it is missing."""
    if found := store.find(sweep.id):
        return str(found.info.run_id), found.info.status, found.data.tags.get(SENT)
    name, command = sweep.path.name, sweep.commands[-1]
    tags = {"kind": "sweep", "sweep": name, "mlflow.note.content": f"`{command}`"}
    run = store.create(sweep.id, f"sweep {name}", command=command, started=sweep.started, tags=tags)
    return run, Status.RUNNING, None
