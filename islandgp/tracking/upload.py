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
from islandgp.tracking.store import ARM, LOCK, SENT, Store, points, run_key
from islandgp.viewer.run_page import write_page

MARKER_METRIC: Final = "fitness_max"  # a metric that every generation has
MAX_POINTS: Final = 1000  # MLflow's limit of points a call

FILES: Final = (*REQUIRED, LONG, MANIFEST, PAGE, "transcript.jsonl")
"""Files of the folder that are sent unchanged. Without error.txt, whose content is in the note:
MLflow cannot delete a file, and a failed run may be resumed."""


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
                    self._send_generations()
                    if status is not Status.RUNNING:
                        self._end(status)
                        self.store.client.set_tag(self._run, SENT, done)
            except BaseException:
                self._run = ""
                raise
            return self._run

    def _is_sent(self, status: Status, done: str) -> bool:
        """True if the store has everything; otherwise makes the run ready for more."""
        store, about, key = self.store, self.about, run_key(self.about)
        run = store.find(key)
        if run is not None and (run.info.status, run.data.tags.get(SENT)) == (status, done):
            self._run = str(run.info.run_id)
            return True
        parent = parent_run(self.folder.path, store)
        if run is not None:
            self._run = str(run.info.run_id)
            if status is Status.RUNNING:
                store.client.update_run(self._run, status=status)
        else:
            arm = arm_of(self.folder.path) or about.tags.get("arm", "")
            tags = {**about.tags, ARM: levels_first(arm)}
            tags |= {"mlflow.parentRunId": parent} if parent else {}
            self._run = store.create(
                key, about.title, command=about.command, started=about.started, tags=tags
            )
            if parent:
                store.delete_children(parent, about.title, without=self._run)
        self._next = store.last_step(self._run, MARKER_METRIC) + 1
        if not self._next:  # else parameters were sent before the first point
            store.log_parameters(self._run, flat(self.folder.configuration()))
        self._progress()
        return False

    def _send_generations(self) -> None:
        """Sends the points of whole generations, as many in a call as MLflow accepts."""
        first = self._next
        missing = self.folder.completed_generations() - first
        records, costs = self.folder.records(first), self.folder.costs(first)
        pairs = zip(islice(records, missing), islice(costs, missing), strict=True)
        constraints = recorded_constraints(self.folder.configuration())
        waiting = [
            points(metric_values(generation_values(record, cost, constraints)), cost["at"], step)
            for step, (record, cost) in enumerate(pairs, first)
        ]
        size = max(1, MAX_POINTS // max(map(len, waiting), default=1))  # generations in a call
        for at in range(0, len(waiting), size):
            batch = waiting[at : at + size]
            self.store.client.log_batch(self._run, metrics=[*chain.from_iterable(batch)])
            self._next += len(batch)
            self._progress()

    def _progress(self) -> None:
        self.has_sent = True
        self._alive()

    def _end(self, status: Status) -> None:
        has_page = self._has_own_page
        if not has_page:
            with suppress(RunError):  # the records are sent without it
                write_page(self.folder, status)
                has_page = True
        client, about = self.store.client, self.about
        end_time = max((int(cost["at"]) for cost in self.folder.costs()), default=about.started)
        # First, so that it is not RUNNING if anything below fails.
        client.set_terminated(self._run, status, end_time)
        with tempfile.TemporaryDirectory(prefix="islandgp-") as copies:
            copy_artifacts(self.folder.path, Path(copies), has_page=has_page)
            client.log_artifacts(self._run, copies)
        self._progress()
        client.set_tag(self._run, "mlflow.note.content", note(self.folder, about, status))
        # Points cannot be deleted, and a stopped run may be resumed.
        if status is Status.FINISHED and self.folder.finished():
            figures = metric_values(run_values(self.folder.summary()))
            numbers = {f"run/{name}": value for name, value in figures.items()}
            client.log_batch(self._run, metrics=points(numbers, end_time, self._next - 1))


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
        client.set_tag(run, "mlflow.note.content", sweep_note(sweep, table, status))
        client.log_text(run, table, "arms.txt")
        client.log_artifact(run, str(sweep.path / "sweep.json"))
        for job in sweep.jobs:
            about = sweep.run(job).about()
            child = None if about is None else store.find(run_key(about))
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
