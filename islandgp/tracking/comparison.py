"""Comparisons and MLflow: runs selected by a filter string, and a report stored as a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from getpass import getuser
from pathlib import Path
from time import time
from typing import Final

from islandgp.errors import StudyError, TrackingError, brief
from islandgp.records.manifest import NAME as MANIFEST
from islandgp.tracking.store import Place, Store, points, valid_names

REQUIRED_FILES: Final = ("config.yaml", "generations.jsonl", "costs.jsonl", "summary.json")
"""The artifacts from which a run's folder is restored."""

MAX_RUNS: Final = 10_000  # most runs that a filter may select


def fetch(place: Place, filter_string: str, cache: Path) -> list[Path]:
    """Downloads the run folders that an MLflow filter selects to `cache`/<run id>.

    Parent runs of sweeps and comparisons are skipped, as they have no records.

    Raises:
        StudyError: the filter is invalid, or selects no run with records.
        TrackingError: the store does not answer.
    """
    from mlflow.exceptions import MlflowException

    if place.file is not None and not place.file.is_file():  # MLflow would create it
        raise TrackingError(f"Expected an MLflow store in {place.file}, found none; give --uri.")
    try:
        store = Store(place)
        page = store.client.search_runs([store.experiment], filter_string, max_results=MAX_RUNS)
        folders = [
            _download(store, str(run.info.run_id), cache)
            for run in page
            if set(REQUIRED_FILES) <= {f.path for f in store.client.list_artifacts(run.info.run_id)}
        ]
    except MlflowException as error:
        if error.error_code == "INVALID_PARAMETER_VALUE":
            raise StudyError(
                f"Expected an MLflow filter, found {filter_string!r}: {brief(error)}"
            ) from error
        raise TrackingError(
            f"Expected an answer from the MLflow store {place.uri}, found {brief(error)}"
        ) from error
    if not folders:
        raise StudyError(
            f"Expected finished runs for the MLflow filter {filter_string!r} in {place.uri}"
            f" (experiment {place.experiment}), found {len(page)} runs, none with records."
        )
    return folders


def _download(store: Store, run: str, cache: Path) -> Path:
    folder = cache / run
    folder.mkdir(parents=True, exist_ok=True)
    paths = {file.path for file in store.client.list_artifacts(run)}
    for name in (*REQUIRED_FILES, *({MANIFEST} & paths)):
        if not (folder / name).exists():
            store.client.download_artifacts(run, name, str(folder))
    return folder


def publish(
    place: Place,
    title: str,
    *,
    folder: Path,
    files: Sequence[Path],
    params: Mapping[str, str],
    metrics: Mapping[str, float],
    note: str,
) -> str:
    """Stores a report as an MLflow run with its files as artifacts; returns a line for the user.

    If the store is unreachable, the line reports it; the report's files exist anyway.
    """
    try:
        store, now = Store(place), int(1000 * time())
        tags = {"kind": "comparison", "mlflow.user": getuser(), "mlflow.note.content": note}
        run = store.client.create_run(store.experiment, tags=tags, run_name=title).info.run_id
        store.log_metrics(run, points(metrics, now, 0))
        store.log_parameters(run, zip(valid_names([*params]), params.values(), strict=True))
        for file in files:
            within = file.relative_to(folder).parent.as_posix()
            store.client.log_artifact(run, str(file), None if within == "." else within)
        store.client.set_terminated(run)
    except Exception as error:
        return (
            f"MLflow: {place.uri} has not got the report ({brief(error)}); the files are complete."
        )
    return f"MLflow: {place.uri}, run {title!r}"
