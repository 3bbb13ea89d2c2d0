"""The last page of a run, written by a process that outlives the command."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import monotonic, time

import pytest

from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.records.manifest import damaged_files, is_as_written
from islandgp.running.page_writer import PageWriter
from islandgp.viewer import last_page
from islandgp.viewer.last_page import MARKER, complete_page, start_page, wait_for_page
from islandgp.viewer.run_page import run_page
from tests.tracking.folders import closed_run

pytestmark = pytest.mark.skipif(os.name != "posix", reason="a command on Windows always waits")


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    """A finished run whose page is that of the unfinished run."""
    folder = closed_run(tmp_path / "run", tmp_path)
    (folder.path / PAGE).write_text(run_page(folder, Status.RUNNING))
    return folder


def test_a_process_completes_the_page(folder: RunFolder) -> None:
    """Whoever needs the page waits for the process, which leaves no marker."""
    assert start_page(folder)
    assert (folder.path / MARKER).exists()
    wait_for_page(folder.path)
    text = (folder.path / PAGE).read_text()
    assert 'data-status="FINISHED"' in text
    assert complete_page(folder).read_text() == text, "it is not written again"
    assert not damaged_files(folder.path)
    assert not (folder.path / MARKER).exists()


def killed() -> str:
    """The id of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return str(process.pid)


@pytest.mark.parametrize(
    ("text", "age"),
    [
        pytest.param(killed, 0.0, id="killed"),
        pytest.param(lambda: str(os.getpid()), 2 * last_page.LIMIT, id="number-used-again"),
        pytest.param(lambda: str(os.getpid()), -1000.0, id="future"),
        pytest.param(lambda: "", 0.0, id="empty"),
        pytest.param(lambda: "9" * 1000, 0.0, id="too-large"),
        pytest.param(lambda: "x", 0.0, id="no-number"),
    ],
)
def test_nobody_waits_for_a_process_that_is_not_at_work(
    text: Callable[[], str], age: float, folder: RunFolder
) -> None:
    """The page is then written by the process that needs it."""
    marker = folder.path / MARKER
    marker.write_text(text())
    os.utime(marker, (time() - age, time() - age))
    began = monotonic()
    complete_page(folder)
    assert monotonic() - began < last_page.LIMIT / 2
    assert is_as_written(folder.path, PAGE)
    assert 'data-status="FINISHED"' in (folder.path / PAGE).read_text()


def test_a_folder_as_marker_is_ignored(folder: RunFolder) -> None:
    """As are all things that a process cannot have written."""
    (folder.path / MARKER).mkdir()
    complete_page(folder)
    assert is_as_written(folder.path, PAGE)


def test_a_changed_page_is_written_again(folder: RunFolder) -> None:
    """As its content is in the other files."""
    complete_page(folder)
    with (folder.path / PAGE).open("a") as page:
        page.write("more")
    complete_page(folder)
    assert is_as_written(folder.path, PAGE)


@pytest.mark.parametrize("starts", [True, False])
def test_a_command_writes_the_page_itself_if_no_process_starts(
    starts: bool, folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For example because there are too many processes."""

    def start(*_: object, **__: object) -> None:
        raise BlockingIOError

    if not starts:
        monkeypatch.setattr(subprocess, "Popen", start)
    PageWriter(folder, leaves=True).end(Status.FINISHED)
    assert is_as_written(folder.path, PAGE) is not starts
    wait_for_page(folder.path)
    assert is_as_written(folder.path, PAGE)


def test_the_page_of_a_stopped_run_is_not_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is short, and the command still writes to the folder."""
    folder = closed_run(tmp_path / "run", tmp_path, 3)
    monkeypatch.setattr(subprocess, "Popen", None)
    PageWriter(folder, leaves=True).end(Status.KILLED)
    assert 'data-status="KILLED"' in (folder.path / PAGE).read_text()
