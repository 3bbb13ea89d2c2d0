"""`islandgp verify`: what is as it was written, and what is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp
from tests.tracking.folders import written
from tests.tracking.test_folder import of_an_older_version


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


def test_runs_as_they_were_written(tmp_path: Path) -> None:
    """Finished and unfinished ones, below any folder."""
    written(tmp_path / "runs/a/one", tmp_path)
    written(tmp_path / "runs/b/two", tmp_path, 3)
    code, said = verified(tmp_path / "runs")
    assert code == 0
    assert said.splitlines() == [
        f"{tmp_path}/runs/a/one: verified: 5 generations, finished",
        f"{tmp_path}/runs/b/two: verified: 3 generations, unfinished",
    ]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("generations.jsonl", b'"generation":2', b'"generation":3'), "of generation 2"),
        (edit("generations.jsonl", b"\n", b""), "Expected 5 generations"),
        (edit("generations.sha256", b"1 ", b"1 0"), "generations.sha256: it differs"),
        (lambda run: (run / "generations.sha256").unlink(), "generations.sha256: it differs"),
        (lambda run: (run / "best.bt").unlink(), "best.bt: it is missing"),
        (lambda run: (run / "best.bt").write_text("PatrolWaypoint\n"), "best.bt: it is not"),
        (
            edit("summary.json", b'"fitness": ', b'"fitness": 9'),
            "summary.json: its champion is not one",
        ),
        (edit("summary.json", b'"records": "', b'"records": "0'), "a record differs"),
        (lambda run: (run / "summary.json").write_text("{"), "found a damaged file"),
        (lambda run: (run / "config.yaml").write_text("- 1"), "found a damaged file"),
    ],
)
def test_what_was_changed_in_a_finished_run_is_named(
    change: Callable[[Path], None], words: str, tmp_path: Path
) -> None:
    """Exit code 1, and the file."""
    folder = written(tmp_path / "one", tmp_path)
    change(folder.path)
    code, said = verified(folder.path)
    assert code == 1
    (line,) = said.splitlines()
    assert f"{folder.path}: damaged: " in line
    assert words in line


def test_a_run_of_an_older_version_is_not_called_verified(tmp_path: Path) -> None:
    """There is nothing to compare; what can be seen without is still looked at."""
    folder = written(tmp_path / "one", tmp_path, 3)
    of_an_older_version(folder)
    assert verified(folder.path) == (
        0,
        f"{folder.path}: not verified: written by an older version\n",
    )
    file = folder.path / "generations.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join((lines[1], lines[0], lines[2])))
    assert "line 1 is not the record of generation 0" in verified(folder.path)[1]


def test_a_folder_without_runs_is_told(tmp_path: Path) -> None:
    """An empty answer would look like a good one."""
    result = CliRunner().invoke(islandgp, ["verify", str(tmp_path)])
    assert "Expected runs in" in str(result.exception)
