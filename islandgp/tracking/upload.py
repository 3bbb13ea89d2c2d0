"""Sends the missing parts of a run's folder to MLflow.

Used by the tracker of a run and by `islandgp sync`. It is idempotent: a run is found by its
id, points are sent from the last step in the store on, and their times are read from the folder,
so that MLflow recognises a repeated point.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Final

from filelock import FileLock

from islandgp.atomic_files import remove_leftovers
from islandgp.errors import RunError, TrackingError
from islandgp.evaluation.base import must_trust_domain
from islandgp.records.files import RunMetadata
from islandgp.records.folder import RunFolder, Status
from islandgp.records.parameters import flat
from islandgp.scoring.constraints import recorded_constraints
from islandgp.sweep.folder import arm_of
from islandgp.tracking.artifacts import TABLE, Artifact, artifacts, note
from islandgp.tracking.metrics import final_metrics, metrics, summary_metrics
from islandgp.tracking.parent import parent_run
from islandgp.tracking.store import ARM, POINTS, Store, points
from islandgp.tracking.sync_state import FILE, LOCK, SyncState, read_state, write_state
from islandgp.viewer.page_file import complete_page

if TYPE_CHECKING:
    from mlflow.entities import Metric

MARKER_METRIC: Final = "fitness/max"  # a metric that every generation has
TABLES: Final = json.dumps([{"path": TABLE, "type": "table"}])  # so that the UI shows a table


def must_be_sendable(folder: RunFolder, status: Status) -> None:
    """Checks a run before a store is opened for it.

    Raises:
        IslandError: the run is damaged, or it was never sent and its domain is not trusted.
    """
    if status is Status.FINISHED and folder.finished():
        folder.must_be_sound()
    if read_state(folder.path) is None:
        _must_be_trusted(folder)


def _must_be_trusted(folder: RunFolder) -> None:
    config = folder.configuration()
    if folder.finished():  # an episode is run for its replay
        must_trust_domain(config)


class RunUploader:
    """Sends one run's folder to an MLflow run: metrics, parameters, tags and artifacts."""

    def __init__(
        self, folder: RunFolder, store: Store, alive: Callable[[], None] = lambda: None
    ) -> None:
        """Does not open the store.

        Args:
            folder: of the run.
            store: to send it to.
            alive: called whenever records were sent.

        Raises:
            TrackingError: no run was started in the folder.
        """
        about = folder.about()
        if about is None:
            raise TrackingError(f"Expected a run's folder, found no about.json in {folder.path}.")
        self.folder, self.store, self.about, self._alive = folder, store, about, alive
        self.has_sent = False  # True once anything was sent
        self._lock = FileLock(folder.path / LOCK)
        self._key = key_of(about)
        self._sure = False  # True once tracking.json was compared with the store

    def send(self, status: Status) -> str:
        """Sends everything missing and returns the MLflow run's id. Errors of MLflow propagate."""
        if status is Status.FINISHED and self.folder.finished():
            self.folder.must_be_sound()
        with self._lock:
            remove_leftovers(self.folder.path, f"{FILE}.*")
            try:
                state = self._sent(status)
                state = self._generations(state)
                if status is not Status.RUNNING:
                    state = self._end(state, status)
            except BaseException:
                self._sure = False  # the contents of the store are unknown now
                raise
            return state.run

    def _sent(self, status: Status) -> SyncState:
        """The state of the store; queried unless it is known."""
        state = read_state(self.folder.path)
        if self._sure and state is not None:
            return state
        place, identity = self.store.place, self.about.identity
        empty = SyncState(place.uri, place.experiment, identity, "")
        if state is None or not state.is_in(place, identity):
            state = empty
        run = self.store.find(self._key, state.run)
        if run is None or not state.done:
            _must_be_trusted(self.folder)
        if run is None:
            state = replace(empty, run=self._create())
        elif run.info.run_id != state.run:
            state = replace(empty, run=str(run.info.run_id))
        start = self.store.last_step(state.run, MARKER_METRIC) + 1
        if start < state.generations:  # an older copy of the store, which may lack other parts too
            state = replace(state, begun=False, done="")
        if run is None or run.info.status != status:
            state = replace(state, done="")
        state = replace(state, generations=start)
        if not state.begun:
            self._begin(state.run)
            self._progress()
            state = replace(state, begun=True)
        arm = arm_of(self.folder.path) or self.about.tags.get("arm", "")
        self.store.client.set_tag(state.run, ARM, arm)
        parent = parent_run(self.folder.path, self.store)
        if parent is not None:
            self.store.client.set_tag(state.run, "mlflow.parentRunId", parent)
        if status is Status.RUNNING:
            self.store.client.update_run(state.run, status=Status.RUNNING)
            state = replace(state, done="")
        write_state(self.folder.path, state)
        self._sure = True
        return state

    def _progress(self) -> None:
        self.has_sent = True
        self._alive()

    def _create(self) -> str:
        about = self.about
        return self.store.create(
            self._key, about.title, command=about.command, started=about.started, tags=about.tags
        )

    def _begin(self, run: str) -> None:
        self.store.log_parameters(run, flat(self.folder.configuration()))
        self.store.client.log_text(run, self.folder.config() or "", "config.yaml")

    def _generations(self, state: SyncState) -> SyncState:
        completed = self.folder.completed_generations()
        while state.generations < completed:
            batch, upto = self._batch(state.generations, completed)
            self.store.client.log_batch(state.run, metrics=batch)
            state = replace(state, generations=upto)
            write_state(self.folder.path, state)
            self._progress()
        return state

    def _batch(self, first: int, end: int) -> tuple[list[Metric], int]:
        """The points of one call from generation `first` on, and the generation after them."""
        batch: list[Metric] = []
        pairs = zip(self.folder.records(first), self.folder.costs(first), strict=False)
        step, constraints = first, recorded_constraints(self.folder.configuration())
        for record, cost in islice(pairs, end - first):
            values = metrics(record, cost, constraints)
            if len(batch) + len(values) > POINTS:
                break
            batch += points(values, cost["at"], step)
            step += 1
        if step == first:
            raise TrackingError(
                f"Expected {end} generations in {self.folder.path}, found {first}; the run's"
                " records are damaged."
            )
        return batch, step

    def _end(self, state: SyncState, status: Status) -> SyncState:
        done = f"{status} {state.generations}"
        if state.done == done:
            return state
        _must_be_trusted(self.folder)
        if status is Status.FINISHED:
            with suppress(RunError):  # the records are sent without it
                complete_page(self.folder)
        client, end_time = self.store.client, self._end_time()
        # First, so that it is not RUNNING if anything below fails.
        client.set_terminated(state.run, status, end_time)
        log_files(self.store, state.run, artifacts(self.folder))
        self._progress()
        client.set_tag(state.run, "mlflow.loggedArtifacts", TABLES)
        client.set_tag(state.run, "mlflow.note.content", note(self.folder, self.about, status))
        # Points cannot be deleted, and a stopped run may be resumed.
        if status is Status.FINISHED and state.generations:
            last = state.generations - 1
            numbers = dict(final_metrics(self.folder.records()))
            if self.folder.finished():
                numbers |= summary_metrics(self.folder.summary())
            self.store.log_metrics(state.run, points(numbers, end_time, last))
        state = replace(state, done=done)
        write_state(self.folder.path, state)
        return state

    def _end_time(self) -> int:
        """Time of the last recorded generation, ms since 1970."""
        return max((int(cost["at"]) for cost in self.folder.costs()), default=self.about.started)


def key_of(about: RunMetadata) -> str:
    """The key of a run for `Store.find`; a folder has another run after `resume=force`."""
    return f"{about.id}.{about.identity}"


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
