"""The files that go with a run into MLflow."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.records.files import PAGE
from islandgp.records.folder import Status
from islandgp.tracking.artifacts import artifacts
from islandgp.viewer.run_page import run_page
from tests.tracking.folders import closed_run


@pytest.mark.parametrize("status", [None, Status.RUNNING, Status.FINISHED])
def test_the_replay_is_that_of_the_page(status: Status | None, tmp_path: Path) -> None:
    """Its episode is not recorded again; a run without a page, or a page without one, has none."""
    folder = closed_run(tmp_path / "run", tmp_path)
    replay = "<b>replay</b>" if status is Status.FINISHED else ""
    if status is not None:
        (folder.path / PAGE).write_text(run_page(folder, status, replay=replay))
    contents = {a.name: a.content for a in artifacts(folder)}
    assert ("replay.html" in contents) == bool(replay)
    if replay:
        assert contents["replay.html"]() == replay  # type: ignore[operator] # a text is made
