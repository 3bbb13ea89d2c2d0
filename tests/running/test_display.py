"""What a run shows may be lost; the run is not."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.profiles import sweep
from tests.running.commands import ROOT, TINY, fake

pytestmark = pytest.mark.process

ARGUMENTS = (*TINY, "tracking=off", *fake("Instant"))
SWEEP = ("seed=0,1", "-m")


@contextmanager
def without_reader() -> Iterator[int]:
    """A pipe at whose other end nobody is, as behind `| head`."""
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)


@contextmanager
def full() -> Iterator[int]:
    """A full disk."""
    with Path("/dev/full").open("wb") as file:
        yield file.fileno()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("stream_kind", "sweep"),
    [
        pytest.param(full, (), id="full-run", marks=pytest.mark.slow),
        pytest.param(without_reader, (), id="no reader-run", marks=pytest.mark.slow),
        pytest.param(without_reader, SWEEP, id="no reader-sweep", marks=pytest.mark.slow),
        pytest.param(full, SWEEP, id="full-sweep", marks=pytest.mark.slow),
    ],
)
def test_a_run_goes_on_when_its_display_takes_no_more(
    stream_kind: type, sweep: tuple[str, ...], tmp_path: Path
) -> None:
    """Exit code 0, and the summary is there; the result still arrives."""
    with stream_kind() as stderr:
        process = subprocess.run(
            [sys.executable, "-m", "islandgp", *ARGUMENTS, *sweep],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=stderr,
            check=False,
        )
    assert process.returncode == 0
    assert b"Results: " in process.stdout
    assert len(list(tmp_path.rglob("summary.json"))) == 1 + bool(sweep)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs a shell")
@sweep(
    "streams",
    [
        "<&- >&- 2>&-",
        "2>&1 | head -2",
        pytest.param("2>&-", marks=pytest.mark.slow),
        pytest.param(">&- 2>&-", marks=pytest.mark.slow),
    ],
    quick=1,
)
def test_a_run_goes_on_without_streams(streams: str, tmp_path: Path) -> None:
    """Closed ones, and both into a pipe that ends; no other file takes their number."""
    script = f'"$0" -m islandgp "$@" {streams}; exit "${{PIPESTATUS[0]}}"'
    process = subprocess.run(
        ["bash", "-c", script, sys.executable, *ARGUMENTS],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    assert process.stderr == ""
    (summary,) = tmp_path.rglob("summary.json")
    assert "\n" in (summary.parent / "generations.jsonl").read_text()
