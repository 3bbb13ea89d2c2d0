"""Which jobs of a sweep have failed in it, for any clocks."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from islandgp.errors import EvaluationError
from islandgp.sweep.folder import SweepJob
from islandgp.sweep.progress import SweepStart
from tests.tracking.folders import closed_run


@pytest.mark.parametrize("ahead", [-3600, 0, 3600])
def test_a_clock_that_differs_from_the_file_systems(ahead: int, tmp_path: Path) -> None:
    """A failure is this sweep's if its file is another one than at the start."""
    folder = closed_run(tmp_path / "one", tmp_path, 2)
    other = closed_run(tmp_path / "two", tmp_path, 2)
    folder.fail(EvaluationError("before"))
    jobs = {
        run.path: SweepJob(run.path.name, run.path.name, "baseline", 1, (), 5, "")
        for run in (folder, other)
    }
    start = SweepStart.now(jobs)
    assert not start.failed(folder)
    assert not start.failed(other)
    for run in (folder, other):
        run.fail(EvaluationError("now"))
        file = run.path / "error.txt"
        at = file.stat().st_mtime + ahead
        os.utime(file, (at, at))
        assert start.failed(run)
