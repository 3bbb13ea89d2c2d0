"""The MLflow pages: the right address, the right view, and errors of use."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from urllib.request import urlopen

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp
from islandgp.errors import TrackingError
from islandgp.evolution.validation import Validation
from islandgp.tracking import ui
from islandgp.tracking.mlflow import sync_command
from islandgp.tracking.store import ARM, Store, TrackingStore
from islandgp.tracking.sync import sync
from islandgp.tracking.ui import runs_page, served, share_view
from tests.running.commands import ROOT
from tests.tracking.folders import closed_run, history, place
from tests.tracking.test_sweep_folder import job, send, started_sweep
from tests.trees.shell import shell
from tests.viewer.browser import Browser, chromium


def test_the_runs_page_is_the_one_with_the_charts() -> None:
    """MLflow itself opens on a page for language models, which is empty."""
    assert runs_page("http://h:1", "7", "CHART") == (
        "http://h:1/#/experiments/7/runs?workflowType=machine_learning&compareRunsMode=CHART"
    )


def test_the_arms_are_those_of_the_latest_sweep(home: Path, store: Store) -> None:
    """Grouped by arm, in the tag where MLflow's pages look for shared views."""
    parents = []
    for name in ("first", "second"):
        closed_run(home / f"runs/{name}/one", home)
        parents.append(send(started_sweep(home / f"runs/{name}", job("one")), store))
    assert share_view(store) == "second"
    text = store.client.get_experiment(store.experiment).tags["mlflow.sharedViewState.arms"]
    assert len(text) < 5000  # MLflow's limit of a tag
    view = json.loads(text)
    assert view["groupBy"]["groupByKeys"] == [{"mode": "tag", "groupByData": ARM}]
    assert "fitness_max" in {chart["metricKey"] for chart in view["compareRunCharts"]}
    latest = store.client.search_runs([store.experiment], view["searchFilter"])
    assert [run.data.tags["mlflow.parentRunId"] for run in latest] == [parents[1]]
    assert [run.data.tags[ARM] for run in latest] == ["baseline"]


def test_a_taken_port_is_named(store: Store) -> None:
    """With the remedy."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(TrackingError, match=rf"port {port} to be free.*--port"):
            served(store.place, port).__enter__()


def test_a_store_that_is_not_there_is_not_made(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A typo in --uri: exit code 2, one line, and no file."""
    monkeypatch.chdir(home)
    result = shell(monkeypatch, capsys)("ui", "--uri", "sqlite:///mlflwo.db")
    line = f"islandgp: Expected an MLflow store in {home / 'mlflwo.db'}, found no such file;"
    assert (result.code, result.out) == (2, "")
    assert result.err.splitlines()[-1].startswith(line)
    assert not (home / "mlflwo.db").exists()


def test_the_extra_with_the_pages_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where MLflow's client alone is installed, as `pip install islandgp` does."""

    def distribution(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(ui, "distribution", distribution)
    file = tmp_path / "mlflow.db"
    file.touch()
    with pytest.raises(TrackingError, match=r"client alone; pip install 'islandgp\[ui\]'"):
        served(TrackingStore(f"sqlite:///{file}", None, "islandgp"), 5000).__enter__()


def test_a_server_that_is_away_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """`islandgp ui --uri` for a server that does not answer."""
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with pytest.raises(TrackingError, match=r"Expected an MLflow store at http://127\.0\.0\.1:9"):
        served(TrackingStore("http://127.0.0.1:9", None, "islandgp"), 5000).__enter__()


UI = """
import sys
from islandgp.cli import main
from islandgp.tracking import ui

def stand_in(place, port):
    quiet = "h.SimpleHTTPRequestHandler.log_message = lambda *_: None"
    serve = f"h.HTTPServer(('127.0.0.1', {port}), h.SimpleHTTPRequestHandler).serve_forever()"
    return [sys.executable, "-c", "\\n".join(["import http.server as h", quiet, serve])]

ui.server_command = stand_in
main()
"""


def free_port() -> int:
    """A port of loopback where nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    "number",
    [
        "SIGINT",
        pytest.param("SIGTERM", marks=pytest.mark.slow),
        pytest.param("SIGHUP", marks=pytest.mark.slow),
    ],
)
def test_the_server_ends_with_the_command(number: str, home: Path) -> None:
    """For any end of the command: by Ctrl-C, by `kill`, by closing the terminal."""
    (home / "health").touch()  # the fake server's answer
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-c", UI, "ui", "--uri", "sqlite:///mlflow.db", "--port", str(port)],
        cwd=home,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        first_line = next(line for line in process.stderr if "Starting" not in line)
        assert first_line == "Only this machine reaches the server. Ctrl-C stops it.\n"
        urlopen(f"http://127.0.0.1:{port}/health", timeout=10).close()
        process.send_signal(getattr(signal, number))
        _, rest = process.communicate(timeout=30)
    finally:
        process.kill()
        process.communicate()
    with socket.socket() as probe:
        is_listening = probe.connect_ex(("127.0.0.1", port)) == 0
    assert not is_listening
    assert (process.returncode, rest) == (0, "stopped\n")


@pytest.mark.parametrize("arguments", [["sync"], ["ui"]], ids=lambda w: w[0])
def test_commands_refuse_a_uri_of_another_kind(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each with the same message, before it looks at any run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    result = CliRunner().invoke(islandgp, [*arguments, "--uri", "foo"])
    assert isinstance(result.exception, TrackingError)
    assert "sqlite:///FILE or http://" in str(result.exception)
    nameless = CliRunner().invoke(
        islandgp, [*arguments, "--uri", "sqlite:///a.db", "--experiment", ""]
    )
    assert isinstance(nameless.exception, TrackingError)
    assert "name of an experiment" in str(nameless.exception)


def test_the_sync_command_counts_what_it_did(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sent once, then known; a folder that is not there is an error of use."""
    monkeypatch.chdir(home)
    closed_run(home / "runs/a/one", home, 2)
    first = CliRunner().invoke(islandgp, ["sync"])
    assert "1 sent, 0 already there, 0 without tracking, 0 not sent" in first.output
    second = CliRunner().invoke(islandgp, ["sync", "runs/a"])
    assert "0 sent, 1 already there" in second.output
    third = CliRunner().invoke(islandgp, ["sync", "nowhere"])
    assert isinstance(third.exception, TrackingError)
    elsewhere = CliRunner().invoke(islandgp, ["sync", "--uri", "sqlite:///mlflow.db"])
    assert "0 sent, 1 already there" in elsewhere.output


def test_the_command_for_several_stores_names_none() -> None:
    """So `sync` finds the one of each run."""
    places = [TrackingStore(f"http://{name}", None, "e") for name in "ab"]
    assert "--uri" not in sync_command([Path("runs/s x")], places)
    assert "--uri http://a --experiment e" in sync_command([Path("runs/s x")], places[:1])


@pytest.mark.slow
def test_sync_sends_again_what_a_store_has_lost(home: Path, template: Path) -> None:
    """A store that was deleted, and one that was replaced by an empty one, get every record."""
    folder = closed_run(home / "runs/a/one", home)
    command = [sys.executable, "-c", "from islandgp.cli import main; main()", "sync"]
    # In a separate process: MLflow holds a file open, and would not see that it is gone.
    subprocess.run(command, cwd=home, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True)
    for empty in (Path.unlink, lambda file: shutil.copy(template, file)):
        empty(home / "mlflow.db")
        assert sync(home, place(home)).sent == [folder.path]
        store = Store(place(home))
        (run,) = store.client.search_runs([store.experiment])
        assert run.info.status == "FINISHED"
        assert [step for step, _ in history(store, run.info.run_id)] == [0, 1, 2, 3, 4]
        assert len(sync(home, place(home)).known) == 1


def test_sync_completes_an_older_copy_of_a_store(home: Path) -> None:
    """Points, description and artifacts that were sent after the copy was made are sent again."""
    closed_run(home / "runs/a/one", home, 2)
    sync(home, place(home))
    shutil.copy(home / "mlflow.db", home / "copy.db")
    closed_run(home / "runs/a/one", home)
    sync(home, place(home))
    shutil.copy(home / "copy.db", home / "mlflow.db")
    shutil.rmtree(home / "mlartifacts")
    assert len(sync(home, place(home)).sent) == 1
    store = Store(place(home))
    (run,) = store.client.search_runs([store.experiment])
    assert run.info.status == "FINISHED"
    assert [step for step, _ in history(store, run.info.run_id)] == [0, 1, 2, 3, 4]
    assert "summary.json" in {f.path for f in store.client.list_artifacts(run.info.run_id)}
    assert len(sync(home, place(home)).known) == 1


def test_sync_reports_nothing_as_stored_if_the_store_is_away(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was sent to it once is `not sent`, as it cannot be checked."""
    folder = closed_run(home / "runs/a/one", home)
    sync(home, place(home))

    def away(place: TrackingStore) -> Store:
        raise ConnectionError(f"{place.uri} is gone")

    monkeypatch.setattr("islandgp.tracking.sync.Store", away)
    report = sync(home, place(home))
    assert (report.known, list(report.failed)) == ([], [folder.path])


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_server_shows_two_arms(home: Path, store: Store) -> None:
    """In headless Chromium: two arms by name and colour, each with its curve; then no server."""
    program = chromium()
    if program is None:
        pytest.skip("no Chromium")
    jobs = []
    for seed, arm in enumerate(("baseline", "expert")):
        validation = Validation((7,), 100.0 + seed, 100.0 + seed, 100.0 + seed, {})
        closed_run(home / f"runs/a/{arm}", home, seed=seed, validation=validation)
        jobs.append(job(arm, f"supervisor={arm}", supervisor=arm, seed=seed))
    send(started_sweep(home / "runs/a", *jobs), store)
    port = free_port()
    with served(store.place, port) as pages, Browser(program, home / "profile") as browser:
        browser.open(pages.arms)
        charts = ("baseline (diversity)", "expert (diversity)")
        text = browser.wait_for(f"Group by: {ARM}", "Group: baseline", "Group: expert", *charts)
        colours = {arm: colour for colour, arm in re.findall(r"(#\w{6})\s+Group: (\w+)", text)}
        assert colours.keys() == {"baseline", "expert"}
        assert len(set(colours.values())) == 2
        curves = "[...document.querySelectorAll('.js-line')].map(line => line.style.stroke).join()"
        browser.wait_for(*map(rgb, colours.values()), script=curves)
        browser.open(pages.runs)
        browser.wait_for("sweep a", "3 matching runs")
        with socket.socket() as probe:  # the whole of 127.* is this machine, but not all is served
            assert probe.connect_ex(("127.0.0.2", port)) != 0
    with pytest.raises(OSError):  # noqa: PT011 -- any error of a closed port
        urlopen(f"http://127.0.0.1:{port}/health", timeout=1)


def rgb(colour: str) -> str:
    """A colour of the form #rrggbb as a style has it."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return f"rgb({red}, {green}, {blue})"
