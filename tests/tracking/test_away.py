"""Stores that are away: the run goes on, its records wait, and `sync` sends them once."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from time import monotonic, sleep
from urllib.request import urlopen

import pytest

from islandgp.records.folder import Status
from islandgp.tracking.mlflow import MLflow
from islandgp.tracking.store import MLflowSettings, Store, TrackingStore
from islandgp.tracking.sync import sync
from islandgp.tracking.upload import RunUploader
from tests.profiles import sweep
from tests.running.commands import TINY, fake, finish, group_members, start
from tests.running.histories import store as open_store
from tests.running.histories import tracked
from tests.tracking import servers
from tests.tracking.folders import archive, begun, closed_run, finished, history, place, steps
from tests.trees.shell import Cli


def tracker(home: Path, uri: str, patience: float) -> MLflow:
    """The tracker for an address."""
    settings = MLflowSettings(
        uri=uri, artifacts="mlartifacts", experiment="islandgp", patience=patience
    )
    return MLflow.make(settings, home)


@sweep("server", [servers.refusing, servers.stalling, servers.broken], quick=1)
def test_a_server_that_is_away_costs_patience_and_nothing_else(
    server: Callable[[], AbstractContextManager[str]], home: Path, store: Store
) -> None:
    """The end waits no longer than its patience (`test_follow`); the message names the remedy."""
    folder = begun(home / "runs/a/one", home)
    with server() as uri:
        follows = tracker(home, uri, 1.5)
        follows.start(folder)
        for step in steps():
            folder.append(step)
            follows.generation()
        message = follows.finish(Status.FAILED)
    folder.close()
    assert f"islandgp sync {folder.path}" in message
    assert uri in message
    report = sync(home / "runs", store.place)
    assert [path.name for path in report.sent] == ["one"]
    (run,) = store.client.search_runs([store.experiment])
    assert len(history(store, run.info.run_id)) == 4
    assert sync(home / "runs", store.place).sent == []


@pytest.mark.slow
def test_a_store_deleted_under_way_is_made_again(
    home: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """With all records from the first one on, and without a traceback."""
    folder = begun(home / "runs/a/one", home)
    follows = tracker(home, "sqlite:///mlflow.db", 120)
    all_steps = steps()
    folder.append(all_steps[0])
    follows.start(folder)
    end = monotonic() + 120
    store = Store(place(home))
    while not any(run.data.metrics for run in store.client.search_runs([store.experiment])):
        assert monotonic() < end
        sleep(0.05)
    (home / "mlflow.db").unlink()
    for step in all_steps[1:]:
        folder.append(step)
        follows.generation()
    folder.finish(finished(folder, all_steps[-1]), archive(all_steps[-1]))
    assert follows.finish(Status.FINISHED).endswith(" shows it")
    folder.close()
    store = Store(place(home))
    (run,) = store.client.search_runs([store.experiment])
    assert [step for step, _ in history(store, run.info.run_id)] == list(range(5))
    assert "Traceback" not in "".join(capfd.readouterr())


def test_a_finished_run_is_sent_again_where_the_store_is_gone(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not announced as being there."""
    monkeypatch.chdir(home)
    folder = closed_run(home / "runs/a/one", home)
    for _ in range(2):
        follows = tracker(home, "sqlite:///mlflow.db", 30)
        follows.start(folder)
        assert follows.finish(Status.FINISHED).endswith(" shows it")
        store = Store(place(home))
        (run,) = store.client.search_runs([store.experiment])
        assert len(history(store, run.info.run_id)) == 5
        (home / "mlflow.db").unlink()


def test_sync_sends_what_runs_and_sweeps_miss(home: Path, store: Store) -> None:
    """Each once; runs without tracking are counted and left alone; one bad folder stops nothing."""
    closed_run(home / "runs/a/one", home)
    closed_run(home / "runs/a/two", home, 2)
    off = closed_run(home / "runs/a/off", home, 1)
    config = (off.config() or "").replace("islandgp.tracking.mlflow:MLflow", "x:Off")
    (off.path / "config.yaml").write_text(config)
    bad = closed_run(home / "runs/a/bad", home, 2)
    (bad.path / "generations.jsonl").write_text("nonsense\n")
    report = sync(home / "runs", places=[place(home)])
    assert [path.name for path in report.sent] == ["one", "two"]
    assert [path.name for path in report.untracked] == ["off"]
    assert [path.name for path in report.failed] == ["bad"]
    second = sync(home / "runs", places=[place(home)])
    assert [path.name for path in second.known] == ["one", "two"]
    runs = {run.info.run_name: run for run in store.client.search_runs([store.experiment])}
    assert (runs["one"].info.status, runs["two"].info.status) == ("FINISHED", "KILLED")


@sweep(
    ("file", "text"),
    [
        ("about.json", "{}"),
        ("about.json", '{"id": "1", "of": "a later version"}'),
        ("about.json", "\0\0"),
        ("config.yaml", "tracking: {factory: islandgp.tracking.mlflow:MLflow}"),
        ("config.yaml", "tracking: ["),
        ("summary.json", "{"),
    ],
    quick=2,
)
def test_a_damaged_folder_is_reported_and_stops_no_other(
    file: str, text: str, home: Path, store: Store
) -> None:
    """Its neighbours are sent, whichever of its files cannot be read."""
    bad = closed_run(home / "runs/a/bad", home)
    sync(home / "runs", places=[place(home)])
    (bad.path / file).write_text(text)
    closed_run(home / "runs/a/one", home)
    report = sync(home / "runs", places=[place(home)])
    assert home / "runs/a/one" in report.sent
    assert [*report.failed] == [bad.path]
    assert len(store.client.search_runs([store.experiment])) == 2


def test_a_damaged_sweep_is_reported_and_stops_no_other(home: Path) -> None:
    """The runs in it, which cannot find their parent, wait as well; those of another are sent."""
    closed_run(home / "runs/a/one", home)
    (home / "runs/a/sweep.json").write_text("{}")
    report = sync(home / "runs", places=[place(home)])
    assert set(report.failed) == {home / "runs/a", home / "runs/a/one"}
    closed_run(home / "runs/b/two", home)
    assert [path.name for path in sync(home / "runs", places=[place(home)]).sent] == ["two"]


def test_the_command_reports_a_damaged_folder_in_a_line(
    home: Path, islandgp: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its file and the remedy, and exit code 2; the folders after it are sent."""
    monkeypatch.chdir(home)
    bad = closed_run(home / "runs/a/bad", home)
    (bad.path / "about.json").write_text("{}")
    closed_run(home / "others/one", home)
    result = islandgp("sync", home / "runs", home / "others")
    assert result.code == 2
    assert "1 sent, 0 already there" in result.out
    assert "correct what each line names" in result.err
    assert "0 sent, 0 already there, 0 without tracking, 1 not sent" in result.out
    assert f"{bad.path / 'about.json'}, found a damaged file (changed)" in result.err
    assert "Traceback" not in result.err


def test_a_run_whose_process_was_killed_does_not_stay_running(home: Path, store: Store) -> None:
    """Its end was not recorded; `sync` sees that no process is at work and records it."""
    folder = begun(home / "runs/a/one", home)
    folder.append(steps()[0])
    run, _ = RunUploader(folder, store).send(Status.RUNNING)
    sync(home / "runs", places=[place(home)])
    assert store.client.get_run(run).info.status == "RUNNING"  # somebody is at work
    folder.close()
    sync(home / "runs", places=[place(home)])
    assert store.client.get_run(run).info.status == "KILLED"


@pytest.mark.slow
@pytest.mark.parametrize("which", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_leaves_a_server_that_does_not_answer(which: signal.Signals, tmp_path: Path) -> None:
    """The run is done: exit code 0, the command that sends the rest, and no process stays."""
    with servers.stalling() as address:
        uri = f"tracking.policy.uri={address}"
        run = start(tmp_path, *TINY, *fake("Instant"), uri, "tracking.policy.patience=300")
        assert run.stdout is not None
        output = ""
        while "Ctrl-C stops waiting" not in output and (line := run.stdout.readline()):
            output += line
        os.killpg(run.pid, which)
        code, rest = finish(run)
    assert code == 0, output + rest
    assert "has not received all records (waiting was interrupted)" in rest
    assert " sync " in rest
    assert "Traceback" not in output + rest
    assert group_members(run.pid) == []


@pytest.mark.slow
def test_two_runs_share_a_store_that_neither_finds(tmp_path: Path) -> None:
    """Both make it at once, and each has all of its points, once."""
    runs = [
        start(tmp_path, *TINY, *fake("Instant"), "tracking.policy.patience=120", f"name={name}")
        for name in ("a", "b")
    ]
    ends = [finish(run) for run in runs]
    assert [code for code, _ in ends] == [0, 0], ends
    tracked_runs = tracked(open_store(tmp_path))
    assert [run.status for run in tracked_runs] == ["FINISHED"] * 2
    for run in tracked_runs:
        assert [step for step, _ in run.points["fitness_max"]] == list(range(6))
    assert tracked_runs[0].points == tracked_runs[1].points


@pytest.mark.slow
def test_a_server_killed_and_started_again_loses_nothing(tmp_path: Path) -> None:
    """`kill -9` of `mlflow server` in the middle of a run; after `sync` all points are there."""
    port = _free_port()
    uri, home = f"http://127.0.0.1:{port}", tmp_path / "home"
    home.mkdir()
    Store(place(tmp_path))  # the server's own file
    server = _serve(tmp_path, port)
    overrides = (
        "supervisor=baseline",
        "gp.population=8",
        "gp.generations=30",
        "evaluator=serial",
        "evaluator.factory=tests.running.evaluators:Slow",
        "++evaluator.policy={seconds:0.3}",
        f"tracking.policy.uri={uri}",
        "tracking.policy.patience=3",
        "progress=off",
    )
    run = start(home, *overrides)
    remote = Store(TrackingStore(uri, None, "islandgp"))
    _until(lambda: bool(remote.client.search_runs([remote.experiment])))
    _kill(server)
    code, output = finish(run)
    assert code == 0, output
    assert "islandgp sync" in output
    server = _serve(tmp_path, port)
    try:
        sync(home / "runs", TrackingStore(uri, None, "islandgp"))
        (stored,) = remote.client.search_runs([remote.experiment])
        assert stored.info.status == "FINISHED"
        assert [step for step, _ in history(remote, stored.info.run_id)] == list(range(30))
    finally:
        _kill(server)


def _kill(server: subprocess.Popen[bytes]) -> None:
    """The server with its workers, which would go on without it."""
    os.killpg(server.pid, signal.SIGKILL)
    server.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _serve(folder: Path, port: int) -> subprocess.Popen[bytes]:
    server = subprocess.Popen(
        [
            *(sys.executable, "-m", "mlflow", "server", "--workers", "1"),
            *("--backend-store-uri", f"sqlite:///{folder}/mlflow.db"),
            *("--host", "127.0.0.1", "--port", str(port)),
        ],
        cwd=folder,
        env={**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )

    def answers() -> bool:
        try:
            with urlopen(f"http://127.0.0.1:{port}/health", timeout=1):
                return True
        except OSError:
            return False

    _until(answers)
    return server


def _until(happened: Callable[[], bool]) -> None:
    end = monotonic() + 60
    while not happened():
        assert monotonic() < end, "nothing happened in 60 s"
        sleep(0.1)
