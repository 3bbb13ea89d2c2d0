"""The paths in a SQLite store: those of a stranger's store lead nowhere, a moved store is found."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

import pytest
from click.testing import CliRunner
from mlflow.tracking._tracking_service import utils

from islandgp.cli import islandgp
from islandgp.errors import IslandError, TrackingError, brief
from islandgp.gate import CONTROL, cleaned
from islandgp.tracking.sqlite_paths import check_addresses
from islandgp.tracking.store import Store, TrackingStore
from islandgp.tracking.sync import place_from, sync
from islandgp.tracking.ui import _pages
from tests.tracking.folders import closed_run, place

SERVER = "http://127.0.0.1:9/x"


def execute(file: Path, statement: str, *values: str | bytes | None) -> None:
    """Executes a statement in a database."""
    with closing(sqlite3.connect(file)) as store, store:
        store.execute(statement, values)


@pytest.mark.parametrize("statement", [
    "UPDATE experiments SET artifact_location = ? WHERE name = 'islandgp'",
    "UPDATE runs SET artifact_uri = ?",
])  # fmt: skip
@pytest.mark.parametrize(
    "value", [SERVER, "s3://b", "/etc", "file:///etc", "file://host/x", "../x"]
)
def test_artifacts_go_nowhere_else(statement: str, value: str, home: Path) -> None:
    """Those of a known run and of a new one are in the configured folder."""
    folder = closed_run(home / "runs/a/one", home, 2)
    sync(home, place(home))
    execute(home / "mlflow.db", statement, value)
    utils._artifact_repos_cache.clear()  # as a new process has none
    closed_run(folder.path, home)
    closed_run(home / "runs/a/two", home)
    assert not sync(home, place(home)).failed
    assert len([*(home / "mlartifacts").rglob("summary.json")]) == 2


def test_a_database_of_another_program_stays_as_it_is(home: Path) -> None:
    """No table is added to it."""
    folder = closed_run(home / "runs/a/one", home, 2)
    (home / "mlflow.db").unlink()
    execute(home / "mlflow.db", "CREATE TABLE mine (x)")
    before = (home / "mlflow.db").read_bytes()
    report = sync(home, place(home))
    assert "found a file of another program" in str(report.failed[folder.path])
    (home / "mlflow.db").write_bytes(b"no database at all" * 100)
    assert "found a file of another program" in str(sync(home, place(home)).failed[folder.path])
    (home / "mlflow.db").write_bytes(before)


def link_artifacts(home: Path) -> None:
    """A link in place of the folder of artifacts."""
    shutil.move(home / "mlartifacts", home / "elsewhere")
    (home / "mlartifacts").symlink_to(home / "elsewhere")


def link_file(home: Path) -> None:
    """A link in place of an artifact."""
    (file,) = (home / "mlartifacts").rglob("best.bt")
    file.unlink()
    file.symlink_to(home / "secret")


@pytest.mark.parametrize("change", [link_artifacts, link_file])
def test_no_artifact_is_written_through_a_link(change: Callable[[Path], None], home: Path) -> None:
    """What it leads to stays as it is."""
    (home / "secret").write_text("mine")
    folder = closed_run(home / "runs/a/one", home, 2)
    sync(home, place(home))
    change(home)
    closed_run(folder.path, home)
    report = sync(home, place(home))
    assert "found a link" in str(report.failed[folder.path])
    assert (home / "secret").read_text() == "mine"


def test_a_store_with_an_address_is_not_served(home: Path) -> None:
    """MLflow's server would connect to it."""
    Store(place(home))
    check_addresses(home / "mlflow.db")
    execute(home / "mlflow.db", "UPDATE experiments SET artifact_location = ?", SERVER)
    with pytest.raises(TrackingError, match=f"found {SERVER}"):
        check_addresses(home / "mlflow.db")


TABLES = ("experiments", "runs", "tags", "params", "experiment_tags", "metrics", "latest_metrics")
VALUES = {
    "a server": SERVER,
    "an outside path": "../../outside",
    "a script": "<script>alert(1)</script>",
    "an escape sequence": "\x1b]0;title\x07\x1b[31mred",
    "another type": b"\xff\x00",
    "nothing": None,
}


@pytest.mark.slow
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("kind", VALUES)
def test_any_value_in_any_column(table: str, kind: str, home: Path) -> None:
    """Runs are sent, or one line says why not; the pages open, or one line says why not."""
    folder = closed_run(home / "runs/a/one", home, 2)
    sync(home, place(home))
    with closing(sqlite3.connect(home / "mlflow.db")) as store:
        columns = [row[1] for row in store.execute(f"PRAGMA table_info({table})")]
    closed_run(folder.path, home)
    original = (home / "mlflow.db").read_bytes()
    before = {file.name for file in home.parent.iterdir()}
    for column in columns:
        (home / "mlflow.db").write_bytes(original)
        # Some columns take no such value.
        with suppress(sqlite3.Error):
            execute(home / "mlflow.db", f"UPDATE {table} SET {column} = ?", VALUES[kind])
        failed = [cleaned(str(error)) for error in sync(home, place(home)).failed.values()]
        assert not any(CONTROL.search(brief(Exception(text))) for text in failed)
        with suppress(TrackingError):
            assert not CONTROL.search(_pages(place(home), "").sweep)
    assert {file.name for file in home.parent.iterdir()} == before


@pytest.mark.parametrize("name", ["new", "c?d", "a%41b", "e f#g"])
def test_a_folder_can_move(name: str, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its runs go to the store in the new place, and their artifacts are found there."""
    old, new = home / "old", home / name
    closed_run(old / "runs/a/one", old, 2)
    shutil.copy(home / "mlflow.db", old)
    sync(old, place(old))
    shutil.move(old, new)
    closed_run(new / "runs/a/one", old)
    monkeypatch.chdir(new)
    utils._artifact_repos_cache.clear()  # as a new process has none
    result = CliRunner().invoke(islandgp, ["sync"])
    assert "1 sent" in result.output, result.exception
    assert not old.exists()
    store = Store(place(new))
    expected = {name, "mlflow.db", "mlartifacts"}  # no folder by the quoted name
    assert {file.name for file in home.iterdir() if not file.name.startswith(".")} <= expected
    (run,) = store.client.search_runs([store.experiment])
    assert "summary.json" in {f.path for f in store.client.list_artifacts(run.info.run_id)}
    assert [*(new / "mlartifacts").rglob("summary.json")]


def test_artifacts_are_beside_the_file_that_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From any folder."""
    monkeypatch.chdir(tmp_path)
    given = place_from(f"sqlite:///{tmp_path}/there/x.db", "e")
    assert given == TrackingStore(
        f"sqlite:///{tmp_path}/there/x.db", f"{tmp_path}/there/mlartifacts", "e"
    )
    with pytest.raises(IslandError, match="found 'ftp://"):
        place_from("ftp://x", "e")
