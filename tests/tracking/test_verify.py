"""`islandgp verify`: what is as it was written, and what is not."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp
from tests.tracking.folders import closed_run


def verified(*paths: Path) -> tuple[int, str]:
    """Exit code and output."""
    result = CliRunner().invoke(islandgp, ["verify", *map(str, paths)])
    return result.exit_code, result.output


def edit(file: str, old: bytes, new: bytes) -> Callable[[Path], None]:
    """Changes the first place in a file of a folder."""

    def change(folder: Path) -> None:
        data = (folder / file).read_bytes()
        assert old in data
        (folder / file).write_bytes(data.replace(old, new, 1))

    return change


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run."""
    home = tmp_path_factory.mktemp("made")
    return closed_run(home / "one", home).path


@pytest.fixture
def one(original: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(original, tmp_path / "one")


def test_runs_as_they_were_written(tmp_path: Path) -> None:
    """Finished and unfinished ones, below any folder."""
    closed_run(tmp_path / "runs/a/one", tmp_path)
    closed_run(tmp_path / "runs/b/two", tmp_path, 3)
    code, output = verified(tmp_path / "runs")
    assert code == 0
    assert output.splitlines() == [
        f"{tmp_path}/runs/a/one: verified: 5 generations, finished",
        f"{tmp_path}/runs/b/two: verified: 3 generations, unfinished",
    ]


def remove(file: str) -> Callable[[Path], None]:
    """Deletes a file of a folder."""
    return lambda folder: (folder / file).unlink()


def write(file: str, text: str) -> Callable[[Path], None]:
    """Writes a file of a folder."""
    return lambda folder: (folder / file).write_text(text) and None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            edit("generations.jsonl", b'"generation":2', b'"generation":3'),
            "generations.jsonl: changed",
        ),
        (remove("generations.jsonl"), "generations.jsonl: missing"),
        (remove("best.bt"), "best.bt: missing"),
        (write("best.bt", "PatrolWaypoint\n"), "best.bt: changed"),
        (
            edit("summary.json", b'"final_fitness_mean": ', b'"final_fitness_mean": 9'),
            "summary.json: changed",
        ),
        (write("summary.json", "{"), "summary.json: changed"),
        (edit("config.yaml", b"seed: ", b"seed: 9"), "config.yaml: changed"),
        (write("config.yaml", "- 1"), "config.yaml: changed"),
        (remove("config.yaml"), "config.yaml: missing"),
        (edit("about.json", b"python", b"pythom"), "about.json: changed"),
        (remove("about.json"), "about.json: missing"),
        (edit("lineage.csv", b"0.1", b"0.2"), "lineage.csv: changed"),
        (write("costs.jsonl", ""), "costs.jsonl: changed"),
        (write("notes.txt", "mine"), "notes.txt: added"),
        (remove("manifest.json"), "manifest.json: missing"),
        (write("manifest.json", "{"), "manifest.json, found a damaged file"),
        (edit("manifest.json", b'"lineage.csv"', b'"lineage.cvs"'), "lineage.csv: added"),
        (lambda run: (run / "best.svg").symlink_to(run / "best.bt"), "best.svg, found a link"),
    ],
)
def test_what_was_changed_in_a_finished_run_is_named(
    change: Callable[[Path], None], message: str, one: Path
) -> None:
    """Exit code 1, the file, and what happened to it."""
    change(one)
    code, output = verified(one)
    assert code == 1
    (line,) = output.splitlines()
    assert f"{one}: damaged: " in line
    assert message in line


def test_every_damaged_file_is_named(one: Path) -> None:
    """In one line."""
    for change in (write("costs.jsonl", ""), remove("lineage.csv"), write("x y", "")):
        change(one)
    assert verified(one)[1].partition(": damaged: ")[2] == (
        "costs.jsonl: changed; lineage.csv: missing; x y: added\n"
    )


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    """An empty answer would look like a good one."""
    result = CliRunner().invoke(islandgp, ["verify", str(tmp_path)])
    assert "Expected runs in" in str(result.exception)
