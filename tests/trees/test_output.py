"""Where a command prints to: a full disk, a pipe that is closed, an encoding without characters."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.running.commands import ROOT

pytestmark = pytest.mark.process

TREE = ROOT / "grammar/examples/all_rounder.bt"
RUN = ("run", "experiment=smoke", "tracking=off", "--cfg", "job")


def command(
    *arguments: object, stdout: Any, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    """Runs `islandgp ARGUMENTS` with that standard output."""
    return subprocess.run(
        [sys.executable, "-c", "from islandgp.cli import main; main()", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        stdout=stdout,
        stderr=subprocess.PIPE,
        check=False,
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("show", TREE), id="show"),
        pytest.param(RUN, id="run"),
        pytest.param(("simplify", TREE), id="simplify", marks=pytest.mark.slow),
        pytest.param(("check", TREE), id="check", marks=pytest.mark.slow),
    ],
)
def test_a_full_output_is_one_message(arguments: tuple[object, ...]) -> None:
    """Exit code 2, no traceback, also where the text fits into the interpreter's buffer."""
    with Path("/dev/full").open("wb") as full:
        process = command(*arguments, stdout=full)
    assert process.returncode == 2
    assert process.stderr.decode() == (
        "islandgp: Expected to write to the standard output, found: No space left on device;"
        " make room, or send it elsewhere.\n"
    )


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("show", TREE), id="show"),
        pytest.param(("simplify", TREE), id="simplify", marks=pytest.mark.slow),
    ],
)
def test_an_output_that_nobody_reads_ends_the_command(arguments: tuple[object, ...]) -> None:
    """As behind `| head`: silently."""
    reader, writer = os.pipe()
    os.close(reader)
    try:
        process = command(*arguments, stdout=writer)
    finally:
        os.close(writer)
    assert (process.returncode, process.stderr) == (1, b"")


def test_pictures_lose_characters_that_the_output_lacks() -> None:
    """In a terminal of ASCII a tree is drawn all the same."""
    process = command("show", TREE, stdout=subprocess.PIPE, PYTHONIOENCODING="ascii")
    assert (process.returncode, process.stderr) == (0, b"")
    assert b"PatrolWaypoint" in process.stdout


def test_trees_are_utf8_for_any_output(tmp_path: Path) -> None:
    """What goes to the standard output is what would go into a file."""
    text = "PatrolWaypoint  # \N{GREEK SMALL LETTER ALPHA}\n"
    with (tmp_path / "tree").open("w+", encoding="utf-8") as file:
        file.write(text)
        file.seek(0)
        process = subprocess.run(
            [sys.executable, "-c", "from islandgp.cli import main; main()", "fmt", "-"],
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "ascii"},
            stdin=file,
            capture_output=True,
            check=False,
        )
    assert (process.returncode, process.stderr) == (0, b"")
    assert process.stdout.decode("utf-8").split() == text.split()
