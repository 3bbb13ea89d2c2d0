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
from collections.abc import Callable, Iterable
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Final

from filelock import FileLock

from islandgp.errors import RunError, TrackingError
from islandgp.records.arms import ArmSummary, arm_table, arms, sweep_note
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import flat
from islandgp.records.sweep import SweepFile, SweepFolder, arm_of
from islandgp.records.values import generation_values, metric_values, run_values
from islandgp.scoring.constraints import recorded_constraints
from islandgp.tracking.artifacts import Artifact, artifacts, note
from islandgp.tracking.store import ARM, LOCK, SENT, Store, points, run_key
from islandgp.viewer.page_file import write_page

MARKER_METRIC: Final = "fitness_max"  # a metric that every generation has


class RunUploader:
    """Sends one run's folder to an MLflow run: metrics, parameters, tags and artifacts."""

    def __init__(
        self,
        folder: RunFolder,
        store: Store,
        alive: Callable[[], None] = lambda: None,
        *,
        has_own_page: bool = False,
    ) -> None:
        """Does not open the store.

        Args:
            folder: of the run.
            store: to send it to.
            alive: called whenever records were sent.
            has_own_page: True: this process has just written the page; False: it is written again
                before it is sent.

        Raises:
            TrackingError: no run was started in the folder.
        """
        about = folder.about()
        if about is None:
            raise TrackingError(f"Expected a run's folder, found no about.json in {folder.path}.")
        self.folder, self.store, self.about, self._alive = folder, store, about, alive
        self._has_own_page = has_own_page
        self.has_sent = False  # True once anything was sent
        self._lock = FileLock(folder.path / LOCK)
        self._run = ""  # MLflow's id; "": the store has to be asked what it has
        self._next = 0  # the first generation that it lacks

    def send(self, status: Status) -> str:
        """Sends everything missing and returns the MLflow run's id. Errors of MLflow propagate.

        Raises:
            IslandError: the run is damaged.
        """
        if status is Status.FINISHED and self.folder.finished():
            self.folder.must_be_sound()
        with self._lock:
            done = f"{status} {self.folder.completed_generations()}"
            try:
                if self._run or not self._is_sent(status, done):
                    self._send(status, done)
            except BaseException:
                self._run = ""
                raise
            return self._run

    def _is_sent(self, status: Status, done: str) -> bool:
        """True if the store has everything; otherwise makes the run ready for more."""
        run = self.store.find(run_key(self.about))
        if run is not None and (run.info.status, run.data.tags.get(SENT)) == (status, done):
            self._run = str(run.info.run_id)
            return True
        about = self.about
        self._run = (
            str(run.info.run_id)
            if run
            else self.store.create(
                run_key(about),
                about.title,
                command=about.command,
                started=about.started,
                tags=about.tags,
            )
        )
        self._next = self.store.last_step(self._run, MARKER_METRIC) + 1
        if not self._next:  # else parameters and configuration were sent before the first point
            self.store.log_parameters(self._run, flat(self.folder.configuration()))
            self.store.client.log_text(self._run, self.folder.config() or "", "config.yaml")
        arm = arm_of(self.folder.path) or self.about.tags.get("arm", "")
        self.store.client.set_tag(self._run, ARM, arm)
        if parent := parent_run(self.folder.path, self.store):
            self.store.client.set_tag(self._run, "mlflow.parentRunId", parent)
            if run is None:
                self.store.delete_children(parent, self.about.title, without=self._run)
        if status is Status.RUNNING:
            self.store.client.update_run(self._run, status=status)
        self._progress()
        return False

    def _send(self, status: Status, done: str) -> None:
        completed, first = self.folder.completed_generations(), self._next
        pairs = zip(self.folder.records(first), self.folder.costs(first), strict=False)
        constraints = recorded_constraints(self.folder.configuration())
        for record, cost in islice(pairs, completed - first):
            values = metric_values(generation_values(record, cost, constraints))
            batch = points(values, cost["at"], self._next)
            self.store.client.log_batch(self._run, metrics=batch)
            self._next += 1
            self._progress()
        if self._next < completed:
            raise TrackingError(
                f"Expected {completed} generations in {self.folder.path}, found {self._next}; the"
                " run's records are damaged."
            )
        if status is not Status.RUNNING:
            self._end(status)
            self.store.client.set_tag(self._run, SENT, done)

    def _progress(self) -> None:
        self.has_sent = True
        self._alive()

    def _end(self, status: Status) -> None:
        has_page = self._has_own_page
        if not has_page:
            with suppress(RunError):  # the records are sent without it
                write_page(self.folder, status)
                has_page = True
        client, end_time = self.store.client, self._end_time()
        # First, so that it is not RUNNING if anything below fails.
        client.set_terminated(self._run, status, end_time)
        log_files(self.store, self._run, artifacts(self.folder, has_page=has_page))
        self._progress()
        client.set_tag(self._run, "mlflow.note.content", note(self.folder, self.about, status))
        # Points cannot be deleted, and a stopped run may be resumed.
        if status is Status.FINISHED and self.folder.finished():
            figures = metric_values(run_values(self.folder.summary()))
            numbers = {f"run/{name}": value for name, value in figures.items()}
            batch = points(numbers, end_time, self._next - 1)
            self.store.client.log_batch(self._run, metrics=batch)

    def _end_time(self) -> int:
        """Time of the last recorded generation, ms since 1970."""
        return max((int(cost["at"]) for cost in self.folder.costs()), default=self.about.started)


def log_files(store: Store, run: str, files: Iterable[Artifact]) -> None:
    """Sends files of an MLflow run, in one call."""
    with tempfile.TemporaryDirectory(prefix="islandgp-") as folder:
        for artifact in files:
            file = Path(folder) / artifact.name
            if isinstance(artifact.content, Path):
                shutil.copyfile(artifact.content, file)
            else:
                file.write_text(artifact.content(), encoding="utf-8")
        store.client.log_artifacts(run, folder)


def parent_run(folder: Path, store: Store) -> str | None:
    """The parent of the run in `folder`, created if missing; None if it is not a sweep's job."""
    sweep = SweepFolder(folder.parent)
    file = sweep.read()
    if file is None or folder.name not in {job.folder for job in file.jobs}:
        return None
    with FileLock(sweep.path / LOCK):
        run, status, _ = _parent(sweep, file, store)
        if status != Status.RUNNING and sweep.at_work():
            store.client.update_run(run, status=Status.RUNNING)
        return run


def send_sweep(sweep: SweepFolder, store: Store, status: Status) -> None:
    """Sends the sweep's summary, if it has changed.

    All jobs must have been sent before. Errors of MLflow propagate.
    """
    file = sweep.read()
    if file is None:
        return
    summaries = arms(sweep, file)
    done = f"{status} {_digest(summaries)}"
    with FileLock(sweep.path / LOCK):
        run, before, sent = _parent(sweep, file, store)
        if status is Status.RUNNING or (before, sent) == (status, done):
            return
        client = store.client
        client.set_terminated(run, status, _end_time(sweep, file))
        client.set_tag(run, "mlflow.note.content", sweep_note(sweep, file, summaries, status))
        client.log_text(run, arm_table(summaries), "arms.txt")
        client.log_artifact(run, str(sweep.path / "sweep.json"))
        for job in file.jobs:
            about = sweep.run(job).about()
            child = None if about is None else store.find(run_key(about))
            if child is not None:
                tags = {ARM: file.arm(job), **file.tags(job), "mlflow.parentRunId": run}
                for name, value in tags.items():
                    client.set_tag(child.info.run_id, name, value)
        client.set_tag(run, SENT, done)


def _parent(sweep: SweepFolder, file: SweepFile, store: Store) -> tuple[str, str, str | None]:
    """Id, status and tag SENT of a sweep's MLflow run, created if it is missing."""
    if found := store.find(file.id):
        return str(found.info.run_id), found.info.status, found.data.tags.get(SENT)
    name, command = sweep.path.name, file.commands[-1]
    tags = {"kind": "sweep", "sweep": name, "mlflow.note.content": f"`{command}`"}
    run = store.create(file.id, f"sweep {name}", command=command, started=file.started, tags=tags)
    return run, Status.RUNNING, None


def _digest(arms: list[ArmSummary]) -> str:
    """Identity of the finished runs; "" if there are none."""
    names = sorted(run.folder for arm in arms for run in arm.finished)
    return hashlib.sha256("\n".join(names).encode()).hexdigest()[:12] if names else ""


def _end_time(sweep: SweepFolder, file: SweepFile) -> int:
    """Time of the last recorded generation of any job, ms since 1970."""
    records = (sweep.path / job.folder / "generations.jsonl" for job in file.jobs)
    times = [int(1000 * path.stat().st_mtime) for path in records if path.exists()]
    return max(times, default=file.started)
