"""MLflow's history of a run is that of an undisturbed one, for any lost request."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from islandgp.records.sweep import read_sweep
from islandgp.tracking import upload
from islandgp.tracking.store import Store
from islandgp.tracking.sync import sync
from tests.tracking.faults import Fault, Faulty, Killed, Stage, live, picture, stages
from tests.tracking.folders import closed_run, place
from tests.tracking.test_sweep_folder import job, send, started_sweep

NEVER = 10**9


@pytest.fixture(scope="module")
def run_stages(tmp_path_factory: pytest.TempPathFactory) -> list[Stage]:
    """The stages of one run's folder: begun, going on, failed, gone on with, finished."""
    return stages(tmp_path_factory.mktemp("grown"))


class Lives:
    """Lives of that run, each with its own folder and store."""

    def __init__(self, run_stages: list[Stage], template: Path, home: Path) -> None:
        self.run_stages, self.template, self.home, self.lived = run_stages, template, home, 0

    def undisturbed(self) -> tuple[object, list[str]]:
        """As `after`."""
        return self.after(NEVER, Fault.LOST, Killed())

    def after(self, at: int, fault: Fault, error: BaseException) -> tuple[object, list[str]]:
        """The store's history after a life with that fault and `sync`, and the requests."""
        self.lived += 1
        home = self.home / str(self.lived)
        run = home / "runs/a/one"
        run.mkdir(parents=True)
        shutil.copy(self.template, home / "mlflow.db")
        store = Faulty(place(home), at, fault, error)
        live(run, self.run_stages, lambda: store)
        store.client.settle()
        sync(home / "runs", store.place)
        second = sync(home / "runs", store.place)
        assert (second.sent, second.failed) == ([], {})
        history = picture(Store(store.place))
        shutil.rmtree(home)
        return history, store.client.requests


@pytest.fixture
def lives(run_stages: list[Stage], template: Path, tmp_path: Path) -> Lives:
    """None yet."""
    return Lives(run_stages, template, tmp_path)


MOMENTS = (
    ("create_run", 0, Fault.UNANSWERED),
    ("create_run", 0, Fault.LATE),
    ("update_run", 0, Fault.LATE),  # it sets RUNNING
    ("log_batch", 2, Fault.LATE),  # the first generations
    ("set_terminated", 0, Fault.LATE),
    ("log_batch", -1, Fault.UNANSWERED),  # the points of the whole run
)
"""A request by its name and its place among those of its name."""


@pytest.mark.slow
def test_a_request_that_fails_changes_nothing_in_the_end(
    lives: Lives, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Status, times, parameters, tags and every point; no second run. Files: the slow test."""
    monkeypatch.setattr(upload, "copy_artifacts", lambda *_, **__: None)
    undisturbed, requests = lives.undisturbed()
    for name, nth, fault in MOMENTS:
        at = [i for i, other in enumerate(requests) if other == name][nth]
        error = Killed() if at % 2 else ConnectionError("reset")
        history, _ = lives.after(at, fault, error)
        assert history == undisturbed, (name, nth, fault)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("fault", Fault)
@pytest.mark.parametrize("error", [ConnectionError("reset"), Killed()], ids=["error", "killed"])
def test_any_request_may_fail(lives: Lives, fault: Fault, error: BaseException) -> None:
    """Each request of a life, one life for each: also the files are the same to the byte."""
    undisturbed, requests = lives.undisturbed()
    for at, name in enumerate(requests):
        if fault is Fault.LATE and name in ("log_artifact", "log_text", "set_tag"):
            continue  # an older text that arrives after a newer one cannot be noticed
        history, _ = lives.after(at, fault, error)
        assert history == undisturbed, (at, name)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("fault", Fault)
def test_any_request_of_a_sweep_may_fail(fault: Fault, template: Path, tmp_path: Path) -> None:
    """Two jobs and their parent: one parent, with each point of its curves once."""
    jobs = [job("one-seed0"), job("one-seed1", seed=1)]
    for entry in jobs:
        closed_run(tmp_path / "runs/a" / entry.folder, tmp_path, seed=entry.seed)
    started_sweep(tmp_path / "runs/a", *jobs)

    def after(at: int) -> tuple[object, list[str]]:
        home = tmp_path / f"home{at}"
        shutil.copytree(tmp_path / "runs", home / "runs")
        shutil.copy(template, home / "mlflow.db")
        store = Faulty(place(home), at, fault, ConnectionError("reset"))
        sweep = read_sweep(home / "runs/a")
        assert sweep is not None
        with suppress(ConnectionError):
            send(sweep, store)
        store.client.settle()
        sync(home / "runs", store.place)
        sync(home / "runs", store.place)
        history = picture(Store(store.place))
        shutil.rmtree(home)
        return history, store.client.requests

    undisturbed, requests = after(NEVER)
    for at, name in enumerate(requests):
        if fault is not Fault.LATE or name not in ("log_artifact", "log_text", "set_tag"):
            assert after(at)[0] == undisturbed, (at, name)
