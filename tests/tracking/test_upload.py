"""The uploader of a run's folder in MLflow: all of it, once, with any interruption."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from mlflow.entities import Run

from islandgp.errors import TrackingError
from islandgp.records.folder import RunFolder, Status
from islandgp.tracking.store import SENT, Store
from islandgp.tracking.upload import RunUploader
from tests.records.listed import add_to_manifest
from tests.tracking.folders import begun, closed_run, history, place, steps


def maxima(generations: int) -> list[tuple[int, float]]:
    """Generation and best fitness, as MLflow should have them."""
    return [(i, step.record.snapshot.fitness_max) for i, step in enumerate(steps()[:generations])]


def run_of(store: Store, folder: RunFolder) -> Run:
    """The folder's MLflow run."""
    about = folder.about()
    assert about is not None
    run = store.find(about.id)
    assert run is not None
    return run


def test_each_generation_is_sent_once_as_it_comes(home: Path, store: Store) -> None:
    """Sending after each generation, and twice after some, gives each point once."""
    folder = begun(home / "runs/a/one", home)
    uploader = RunUploader(folder, store)
    for i, step in enumerate(steps()[:4]):
        folder.append(step)
        run, _ = uploader.send(Status.RUNNING)
        if i % 2:
            uploader.send(Status.RUNNING)
    folder.close()
    assert history(store, run) == maxima(4)
    assert run_of(store, folder).info.status == "RUNNING"


def test_a_generation_that_may_be_taken_back_is_not_sent(home: Path, store: Store) -> None:
    """A line that no checkpoint covers is made again after a kill, so it stays at home."""
    folder = begun(home / "runs/a/one", home)
    all_steps = steps()
    folder.append(all_steps[0])
    folder.append(replace(all_steps[1], state=None))
    run, _ = RunUploader(folder, store).send(Status.RUNNING)
    folder.close()
    assert history(store, run) == maxima(1)


def test_nothing_is_doubled_after_an_end_that_was_cut_off(home: Path, store: Store) -> None:
    """The last request sets a tag; without it, the end is sent again."""
    folder = closed_run(home / "runs/a/one", home)
    run, _ = RunUploader(folder, store).send(Status.FINISHED)
    assert run_of(store, folder).data.tags[SENT] == "FINISHED 5"
    store.client.delete_tag(run, SENT)
    for sends in (True, False):
        assert RunUploader(folder, store).send(Status.FINISHED) == (run, sends)
    assert history(store, run) == maxima(5)
    assert len(store.client.search_runs([store.experiment])) == 1


def test_an_error_half_way_loses_and_doubles_nothing(
    home: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A store that takes points and fails before its answer gets no point twice."""
    folder = closed_run(home / "runs/a/one", home)
    uploader, log_batch = RunUploader(folder, store), store.client.log_batch

    def fails_after(run: str, **batch: object) -> None:
        log_batch(run, **batch)
        if "metrics" in batch:
            raise ConnectionError("gone")

    monkeypatch.setattr(store.client, "log_batch", fails_after)
    with pytest.raises(ConnectionError):
        uploader.send(Status.FINISHED)
    monkeypatch.undo()
    run, _ = uploader.send(Status.FINISHED)
    assert history(store, run) == maxima(5)


@pytest.mark.replay
def test_a_finished_run_has_everything_that_people_look_for(home: Path, store: Store) -> None:
    """Name, parameters, tags, description, previews, and the end's time from the records."""
    folder = closed_run(home / "runs/a/baseline-seed1", home)
    run, _ = RunUploader(folder, store).send(Status.FINISHED)
    stored = store.client.get_run(run)
    assert stored.info.run_name == "baseline-seed1"
    assert stored.info.status == "FINISHED"
    assert stored.info.start_time == 1_700_000_000_000
    assert stored.info.end_time == [cost["at"] for cost in folder.costs()][-1]
    assert stored.data.params["gp.population"] == "8"
    assert stored.data.params["supervisor.name"] == "baseline"
    assert stored.data.tags["supervisor"] == "baseline"
    assert "Best robot" in stored.data.tags["mlflow.note.content"]
    assert {file.path for file in store.client.list_artifacts(run)} == {
        "about.json",
        "archive.json",
        "best.bt",
        "best.bt.txt",
        "best.svg",
        "config.yaml",
        "costs.jsonl",
        "generations.jsonl",
        "lineage.csv",
        "manifest.json",
        "run.html",
        "summary.json",
    }


def test_a_run_goes_on_in_the_same_mlflow_run(home: Path, store: Store) -> None:
    """Stopped after two generations it is KILLED, then RUNNING, then FINISHED, under one id."""
    folder = closed_run(home / "runs/a/one", home, 2)
    run, _ = RunUploader(folder, store).send(folder.status())
    assert run_of(store, folder).info.status == "KILLED"
    reopened = RunFolder(folder.path)
    about = folder.about()
    assert about is not None
    reopened.open(folder.config() or "", about)
    uploader = RunUploader(reopened, store)
    assert uploader.send(Status.RUNNING)[0] == run
    assert run_of(store, folder).info.status == "RUNNING"
    reopened.resume()
    for step in steps()[2:]:
        reopened.append(step)
    assert uploader.send(Status.FAILED)[0] == run
    reopened.close()
    assert history(store, run) == maxima(4)


def test_another_store_gets_all_of_it(home: Path, store: Store) -> None:
    """A place that has not got the run gets everything, independent of other places."""
    folder = closed_run(home / "runs/a/one", home)
    RunUploader(folder, store).send(Status.FINISHED)
    elsewhere = Store(place(home, "elsewhere"))
    run, _ = RunUploader(folder, elsewhere).send(Status.FINISHED)
    assert history(elsewhere, run) == maxima(5)


def test_a_deleted_mlflow_run_is_made_again(home: Path, store: Store) -> None:
    """Somebody who deletes a run in the UI and sends it again gets it again."""
    folder = closed_run(home / "runs/a/one", home)
    first, _ = RunUploader(folder, store).send(Status.FINISHED)
    store.client.delete_run(first)
    second, _ = RunUploader(folder, store).send(Status.FINISHED)
    assert second != first
    assert history(store, second) == maxima(5)


def test_what_was_sent_is_not_sent_again(home: Path) -> None:
    """A second uploader finds nothing to send; another place lacks all of it."""
    folder = closed_run(home / "runs/a/one", home)
    batches = []
    for name in ("islandgp", "islandgp", "elsewhere"):
        _, has_sent = RunUploader(folder, Store(place(home, name))).send(Status.FINISHED)
        batches.append(has_sent)
    assert batches == [True, False, True]


def test_a_secret_in_the_configuration_is_no_parameter(home: Path, store: Store) -> None:
    """What `redacted` hid on disk is hidden in MLflow."""
    folder = closed_run(home / "runs/a/one", home)
    config = (folder.config() or "") + "\nsupervisor_api_key: '***'\n"
    (folder.path / "config.yaml").write_text(config)
    add_to_manifest(folder.path, "config.yaml")
    run, _ = RunUploader(folder, store).send(Status.FINISHED)
    assert store.client.get_run(run).data.params["supervisor_api_key"] == "***"


def test_a_folder_that_is_no_run_is_refused(home: Path, store: Store) -> None:
    """The message names what is missing and where."""
    with pytest.raises(TrackingError, match=r"found no about\.json in"):
        RunUploader(RunFolder(home), store).send(Status.RUNNING)
