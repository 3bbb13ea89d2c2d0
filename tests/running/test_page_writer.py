"""The page of a run, which its records do not depend on."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from islandgp.records.folder import Status
from islandgp.running.page_writer import PageWriter
from islandgp.viewer import last_page
from tests.tracking.folders import closed_run


def test_a_page_that_cannot_be_written_is_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One whole line with the reason and the remedy, however long the folder's name is."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(last_page, "write_atomic", full)
    folder = closed_run(tmp_path / ("a" * 200) / "one", tmp_path)
    writer = PageWriter(folder)
    writer.end(Status.KILLED)
    writer.end(Status.KILLED)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("islandgp: no new run.html: Expected a folder to read and write")
    assert f"found: {os.strerror(errno.ENOSPC)}" in line
    assert line.endswith("choose another place with runs=...")
