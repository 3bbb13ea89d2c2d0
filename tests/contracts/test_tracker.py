"""What every tracker promises: it follows the folder, and stays out of the run's way."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import pytest

from islandgp.records.folder import RunFolder, Status
from islandgp.tracking.base import Off, Tracker
from islandgp.tracking.mlflow import MLflow
from islandgp.tracking.store import MLflowSettings, Store
from tests.tracking.folders import begun, closed_run, place, steps

pytestmark = pytest.mark.process


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a store."""
    home = tmp_path_factory.mktemp("store")
    Store(place(home))
    return home


def off(home: Path) -> Tracker:
    """No tracking."""
    return Off.make(Off.Settings(), home)


def mlflow(home: Path) -> Tracker:
    """MLflow with the default store."""
    settings = MLflowSettings(
        uri="sqlite:///mlflow.db", artifacts="mlartifacts", experiment="islandgp", patience=60
    )
    return MLflow.make(settings, home)


def mlflow_away(home: Path) -> Tracker:
    """MLflow with a server that is not there."""
    settings = MLflowSettings(
        uri="http://127.0.0.1:9", artifacts="mlartifacts", experiment="islandgp", patience=0.1
    )
    return MLflow.make(settings, home)


Make = Callable[[Path], Tracker]
ALL = pytest.mark.parametrize("make", [off, mlflow, mlflow_away])


@pytest.fixture
def home(tmp_path: Path, prepared: Path) -> Path:
    """A folder in which commands are given."""
    shutil.copy(prepared / "mlflow.db", tmp_path / "mlflow.db")
    return tmp_path


def content(folder: RunFolder) -> dict[str, bytes]:
    """The records of a folder."""
    names = ("config.yaml", "about.json", "generations.jsonl", "costs.jsonl", "best.bt")
    files = (folder.path / name for name in names)
    return {file.name: file.read_bytes() for file in files if file.exists()}


@ALL
def test_a_tracker_follows_a_whole_run(make: Make, home: Path) -> None:
    """Start, generations, finish; what it returns is text; it changes no record."""
    folder = begun(home / "runs/a/one", home)
    tracker = make(home)
    tracker.start(folder)
    for step in steps()[:3]:
        folder.append(step)
        tracker.generation()
    before = content(folder)
    assert isinstance(tracker.finish(Status.KILLED), str)
    folder.close()
    assert content(folder) == before


@ALL
def test_a_tracker_never_makes_a_generation_wait(make: Make, home: Path) -> None:
    """Neither the start nor a generation waits for the store."""
    folder = begun(home / "runs/a/one", home)
    tracker = make(home)
    before = perf_counter()
    tracker.start(folder)
    for _ in range(3):
        tracker.generation()
    assert perf_counter() - before < 2  # the import of MLflow takes longer
    tracker.finish(Status.FAILED)
    folder.close()


@ALL
@pytest.mark.parametrize("status", [Status.FINISHED, Status.FAILED, Status.KILLED])
def test_a_tracker_takes_any_end(make: Make, status: Status, home: Path) -> None:
    """Also of a run that has no generation, and also of one that was tracked before.

    What a store knows of it is one run that has come to this end.
    """
    folder = begun(home / "runs/a/one", home)
    folder.close()
    before, ends = content(folder), []
    for _ in range(2):
        tracker = make(home)
        tracker.start(folder)
        message = tracker.finish(status)
        assert ("islandgp sync" in message) == (make is mlflow_away)
        store = Store(place(home))
        runs = store.client.search_runs([store.experiment])
        ends.append([run.info.status for run in runs])
    assert ends == [[status]] * 2 if make is mlflow else ends == [[]] * 2
    assert content(folder) == before


@ALL
def test_a_tracker_can_be_given_a_run_that_is_over(make: Make, home: Path) -> None:
    """A command for a finished run sends what is missing, and nothing twice."""
    folder = closed_run(home / "runs/a/one", home)
    messages = []
    for _ in range(2):
        tracker = make(home)
        tracker.start(folder)
        messages.append(tracker.finish(Status.FINISHED))
    assert messages[0] == messages[1]
