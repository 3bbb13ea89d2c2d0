"""The store: made safely by many at once, and in the place that is meant."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from pydantic import ValidationError

from islandgp.errors import TrackingError
from islandgp.tracking.store import MLflowSettings, Store, TrackingStore, points
from tests.running.commands import ROOT
from tests.tracking.folders import place

START = """
import sys
from pathlib import Path
from islandgp.tracking.store import MLflowSettings, TrackingStore, Store
settings = MLflowSettings(
    uri="sqlite:///mlflow.db", artifacts="mlartifacts", experiment="islandgp", patience=0
)
store = Store(TrackingStore.of(settings, Path(sys.argv[1])))
store.client.create_run(store.experiment)
"""


def start(home: Path) -> subprocess.Popen[str]:
    """A process that opens the store of a folder and makes a run in it."""
    return subprocess.Popen(
        [sys.executable, "-c", START, str(home)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("attempt", range(10))
def test_eight_processes_may_start_on_no_store_at_all(tmp_path: Path, attempt: int) -> None:
    """All eight succeed, ten times out of ten."""
    processes = [start(tmp_path) for _ in range(8)]
    outputs = [process.communicate()[0] for process in processes]
    assert [process.returncode for process in processes] == [0] * 8, outputs[attempt % 8]
    store = Store(place(tmp_path))
    assert len(store.client.search_runs([store.experiment])) == 8


@pytest.mark.process
def test_threads_may_make_a_store_at_once(tmp_path: Path) -> None:
    """One makes the file, as it would among processes; all agree on its experiment."""
    with ThreadPoolExecutor(4) as pool:
        stores = list(pool.map(lambda _: Store(place(tmp_path)), range(4)))
    assert len({store.experiment for store in stores}) == 1


def test_paths_are_meant_from_where_the_command_was_given(tmp_path: Path) -> None:
    """A job in another folder finds the same file and the same artifacts."""
    resolved = place(tmp_path / "here")
    assert resolved.uri == f"sqlite:///{tmp_path}/here/mlflow.db"
    assert resolved.artifacts == f"{tmp_path}/here/mlartifacts"
    absolute = MLflowSettings(
        uri=f"sqlite:///{tmp_path}/there.db", artifacts="/x", experiment="e", patience=0
    )
    assert TrackingStore.of(absolute, tmp_path).uri == f"sqlite:///{tmp_path}/there.db"


def test_a_server_has_its_artifacts(tmp_path: Path) -> None:
    """With a tracking server there is no local path for files."""
    settings = MLflowSettings(
        uri="http://host:5000/", artifacts="mlartifacts", experiment="e", patience=0
    )
    assert TrackingStore.of(settings, tmp_path) == TrackingStore("http://host:5000", None, "e")


def test_artifacts_are_beside_the_store(store: Store, home: Path) -> None:
    """The experiment's artifact location is explicit and absolute."""
    experiment = store.client.get_experiment(store.experiment)
    assert experiment.artifact_location == str(home / "mlartifacts")


def test_metrics_of_any_name_are_stored(store: Store) -> None:
    """Costs and sources of a user's supervisor may have names that MLflow rejects."""
    run = store.client.create_run(store.experiment).info.run_id
    store.client.log_batch(run, points({"cost/price (EUR)": 1.0, "decisions/a+b": 0.5}, 0, 3))
    assert store.client.get_run(run).data.metrics == {"cost/price _EUR_": 1.0, "decisions/a_b": 0.5}
    assert store.last_step(run, "decisions/a_b") == 3


@pytest.mark.parametrize("uri", ["mlruns", "file:///x", "sqlite:///", "", "http://me:word@host"])
def test_a_uri_that_cannot_work_is_refused(uri: str) -> None:
    """File stores and nonsense are errors of the configuration, before anything starts."""
    with pytest.raises(ValidationError):
        MLflowSettings(uri=uri, artifacts="a", experiment="e", patience=0)


def test_a_deleted_experiment_is_named(home: Path, store: Store) -> None:
    """The remedy is in the message."""
    store.client.delete_experiment(store.experiment)
    with pytest.raises(TrackingError, match="found it deleted; restore it"):
        Store(place(home))


@pytest.mark.slow
def test_half_a_store_is_never_seen(tmp_path: Path) -> None:
    """An empty file, as a killed process may leave it, is replaced by a whole store."""
    (tmp_path / "mlflow.db").touch()
    store = Store(place(tmp_path))
    assert store.client.get_experiment(store.experiment).name == "islandgp"
