"""Damage to a finished run: every reader reports it and uses no damaged file."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

import islandgp
from islandgp.cli import islandgp as group
from islandgp.errors import RunError, UntrustedError
from islandgp.records.folder import RunFolder, run_folders
from islandgp.records.manifest import NAME, UNLISTED, damaged_files, read_manifest
from islandgp.running.app import main
from islandgp.tracking.sync import place_from, sync
from tests.tracking.folders import begun, closed_run, finished, steps

TINY = (
    *("supervisor=baseline", "gp.population=4", "gp.generations=2", "gp.validation=0"),
    *("tracking=off", "evaluator=serial", "progress=off"),
    "evaluator.factory=tests.running.evaluators:Instant",
)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder in which the command has finished a run."""
    home = tmp_path_factory.mktemp("made")
    before = Path.cwd()
    os.chdir(home)
    try:
        assert main([*TINY]) == 0
    finally:
        os.chdir(before)
    return home


@pytest.fixture
def run(original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The run in a copy of that folder, the working folder."""
    shutil.copytree(original, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    (folder,) = run_folders(tmp_path / "runs")
    return folder.path


def change(file: Path) -> None:
    """Another digit."""
    data = file.read_bytes()
    at = next((i for i in range(len(data) - 1, 0, -1) if data[i : i + 1].isdigit()), 0)
    file.write_bytes(data[:at] + (b"1" if data[at : at + 1] != b"1" else b"2") + data[at + 1 :])


def test_all_files_of_a_run_have_an_entry(run: Path) -> None:
    """But the page, which is written again before it is opened or sent."""
    manifest = read_manifest(run)
    visible = {f.name for f in run.iterdir() if not f.name.startswith(".")}
    assert {*manifest} == visible - UNLISTED
    assert damaged_files(run) == {}


COVERED = (
    *("about.json", "archive.json", "best.bt", "config.yaml", "costs.jsonl", "generations.jsonl"),
    *("lineage.csv", "summary.json"),
)


@pytest.mark.parametrize("name", COVERED)
def test_a_run_with_a_changed_file_is_not_sound(name: str, run: Path) -> None:
    """Each file is compared."""
    RunFolder(run).must_be_sound()
    change(run / name)
    with pytest.raises(RunError, match=rf"{name}, found a damaged file \(changed\)"):
        RunFolder(run).must_be_sound()


@pytest.mark.parametrize("name", ["generations.jsonl", "lineage.csv", NAME])
def test_a_deleted_file_is_not_called_complete(
    name: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also the manifest itself: without it nothing would be compared."""
    (run / name).unlink()
    assert main([*TINY]) == 2
    assert f"{run / name}, found a damaged file (missing)" in capsys.readouterr().err


def test_the_page_is_written_again(run: Path) -> None:
    """As it has no entry, a changed or a missing one is no damage."""
    (run / "run.html").write_text("changed")
    RunFolder(run).must_be_sound()
    assert main([*TINY]) == 0
    assert (run / "run.html").read_bytes().startswith(b"<!doctype html>")


def test_watch_opens_no_page_of_another(run: Path) -> None:
    """A changed page is made again; a damaged run is refused."""
    (run / "run.html").write_text("<script>")
    result = CliRunner().invoke(group, ["watch", str(run), "--no-open"])
    assert result.exit_code == 0, result.output
    assert (run / "run.html").read_bytes().startswith(b"<!doctype html>")
    assert damaged_files(run) == {}
    change(run / "generations.jsonl")
    result = CliRunner().invoke(group, ["watch", str(run), "--no-open"])
    assert "found a damaged file (changed)" in str(result.exception)


READERS: dict[str, Callable[[Path], object]] = {
    "runs": lambda run: islandgp.load(run).runs,
    "generations": lambda run: islandgp.load(run).generations,
    "archive": lambda run: islandgp.load(run).archive,
    "summary": lambda run: RunFolder(run).summary(),
    "costs": lambda run: list(RunFolder(run).costs()),
    "archive file": lambda run: RunFolder(run).archive(),
}


@pytest.mark.parametrize(
    ("reader", "name"),
    [
        *(("runs", n) for n in ("summary.json", "config.yaml", "about.json")),
        *(("generations", n) for n in ("generations.jsonl", "config.yaml")),
        ("archive", "archive.json"),
        ("summary", "summary.json"),
        ("costs", "costs.jsonl"),
        ("archive file", "archive.json"),
    ],
)
def test_every_reader_reports_a_damaged_file(reader: str, name: str, run: Path) -> None:
    """For any number that was changed in it."""
    READERS[reader](run)
    change(run / name)
    with pytest.raises(RunError, match=rf"{name}, found a damaged file \(changed\)"):
        READERS[reader](run)


def test_a_run_without_about_json_does_not_vanish(run: Path) -> None:
    """It is listed, and every reader names what is missing."""
    (run / "about.json").unlink()
    assert [folder.path for folder in run_folders(run.parent)] == [run]
    with pytest.raises(RunError, match=r"about\.json, found a damaged file \(missing\)"):
        islandgp.load(run.parent)


@pytest.mark.parametrize("name", ["generations.jsonl", "summary.json"])
def test_sync_sends_no_damaged_run(name: str, run: Path) -> None:
    """The file is named, and no store is made for it."""
    change(run / name)
    report = sync(run, place_from("sqlite:///mlflow.db", "islandgp"))
    assert f"{run / name}, found a damaged file (changed)" in str(report.failed[run])
    assert not Path("mlflow.db").exists()


@pytest.mark.parametrize(("name", "what"), [("config.yaml", "missing"), ("best.bt", "changed")])
def test_the_tree_of_a_damaged_run_is_not_read(name: str, what: str, run: Path) -> None:
    """A run's tree and its world are those of the end of the run, or the file is named."""
    if what == "missing":
        (run / name).unlink()
    else:
        change(run / name)
    result = CliRunner().invoke(group, ["show", str(run)])
    assert isinstance(result.exception, RunError) or result.exit_code == 2
    assert f"{run / name}, found a damaged file ({what})" in f"{result.exception}{result.output}"


def test_a_relative_store_in_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its artifacts are beside it."""
    monkeypatch.chdir(tmp_path)
    place = place_from("sqlite:///stores/mlflow.db", "islandgp")
    assert place.file == tmp_path / "stores/mlflow.db"
    assert place.artifacts == str(tmp_path / "stores/mlartifacts")


@pytest.mark.parametrize("name", ["best.bt", "transcript.jsonl", ".lock", "generations.jsonl"])
def test_a_link_is_neither_followed_nor_sent(name: str, run: Path, tmp_path: Path) -> None:
    """Whether or not the manifest has an entry for it; what it leads to stays as it is."""
    secret = tmp_path / "secret"
    secret.write_text("mine")
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(secret)
    report = sync(run, place_from("sqlite:///mlflow.db", "islandgp"))
    assert isinstance(report.failed[run], UntrustedError)
    for reader in READERS.values():
        with pytest.raises(UntrustedError, match=f"{name}, found a link"):
            reader(run)
    with pytest.raises(UntrustedError):
        RunFolder(run).status()
    assert secret.read_text() == "mine"


def test_a_pipe_is_not_read(run: Path) -> None:
    """It would never end."""
    (run / "summary.json").unlink()
    os.mkfifo(run / "summary.json")
    with pytest.raises(UntrustedError, match=r"summary\.json, found none"):
        RunFolder(run).summary()


@pytest.mark.parametrize("generation", [3, 5])
@pytest.mark.parametrize("damage", ["changed", "longer", "gone"])
def test_records_that_change_under_a_run_fail_it(
    damage: str, generation: int, tmp_path: Path
) -> None:
    """At the end, before it is called finished."""
    folder = begun(tmp_path / "one", tmp_path)
    all_steps = steps()
    end = finished(closed_run(tmp_path / "two", tmp_path), all_steps[-1])
    for step in all_steps[:generation]:
        folder.append(step)
    file = folder.path / "generations.jsonl"
    match damage:
        case "changed":
            change(file)
        case "longer":
            file.write_bytes(file.read_bytes() + b"x")
        case "gone":
            file.unlink()
    for step in all_steps[generation:]:
        folder.append(step)
    with pytest.raises(RunError, match=r"generations\.jsonl as this run wrote them, found them"):
        folder.finish(end)
    folder.close()
    assert not folder.finished()
    assert not (folder.path / NAME).exists()


def test_a_manifest_of_an_end_that_did_not_come_is_removed(tmp_path: Path) -> None:
    """It is written before the summary; a run killed in between goes on."""
    folder = closed_run(tmp_path / "one", tmp_path, 4)
    (folder.path / NAME).write_text("{}")
    begun(folder.path, tmp_path).close()
    assert not (folder.path / NAME).exists()
