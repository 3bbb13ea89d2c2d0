"""The last page of a run, written by a process that outlives the command."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from threading import Thread
from time import monotonic, sleep, time

import pytest
from filelock import FileLock

from islandgp.errors import BusyError, RunError, UntrustedError
from islandgp.records import folder as folder_module
from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.records.manifest import damaged_files, is_as_written
from islandgp.running.page_writer import PageWriter
from islandgp.trust import is_own_code
from islandgp.viewer import last_page
from islandgp.viewer.last_page import START_LIMIT, complete_page, start_page, wait_for_page
from islandgp.viewer.run_page import run_page
from tests.composed import plain
from tests.tracking.folders import begun, closed_run

pytestmark = pytest.mark.skipif(os.name != "posix", reason="a command on Windows always waits")


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    """A finished run whose page is that of the unfinished run."""
    folder = closed_run(tmp_path / "run", tmp_path)
    (folder.path / PAGE).write_text(run_page(folder, Status.RUNNING))
    return folder


def aged(folder: RunFolder, seconds: float) -> None:
    """The run ended some seconds ago."""
    when = time() - seconds
    os.utime(folder.path / "summary.json", (when, when))


def test_a_process_completes_the_page(folder: RunFolder) -> None:
    """It is complete after `wait_for_page`, and is not written again."""
    assert start_page(folder)
    wait_for_page(folder)
    text = (folder.path / PAGE).read_text()
    assert 'data-status="FINISHED"' in text
    complete_page(folder)
    assert (folder.path / PAGE).read_text() == text
    assert not damaged_files(folder.path)


@pytest.mark.parametrize("age", [2 * START_LIMIT, -100.0])
def test_nobody_waits_for_a_process_that_cannot_be_at_work(age: float, folder: RunFolder) -> None:
    """The run ended long ago, or a clock is wrong."""
    aged(folder, age)
    began = monotonic()
    wait_for_page(folder)
    assert monotonic() - began < START_LIMIT / 2
    assert not is_as_written(folder.path, PAGE)


@pytest.mark.parametrize("page", [True, False])
def test_nobody_waits_without_a_need(page: bool, tmp_path: Path) -> None:
    """A run whose page is complete, and one that has none."""
    folder = closed_run(tmp_path / "run", tmp_path)
    if page:
        complete_page(folder)
    began = monotonic()
    wait_for_page(folder)
    assert monotonic() - began < START_LIMIT / 2


def test_a_reader_waits_for_the_process_that_has_the_lock(folder: RunFolder) -> None:
    """However long ago the run has ended."""
    aged(folder, 2 * START_LIMIT)
    lock = FileLock(folder.path / ".lock", thread_local=False)

    def work() -> None:
        sleep(0.1)
        lock.release()

    with lock:
        Thread(target=work).start()
        wait_for_page(folder)
        assert not lock.is_locked


def test_a_page_is_written_by_one_process_at_a_time(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another one waits for it, and then gives up."""
    monkeypatch.setattr(folder_module, "LOCK_LIMIT", 0.05)
    with FileLock(folder.path / ".lock"), pytest.raises(BusyError, match="another process"):
        complete_page(folder)
    assert not is_as_written(folder.path, PAGE)
    complete_page(folder)
    assert is_as_written(folder.path, PAGE)


def test_a_changed_page_is_written_again(folder: RunFolder) -> None:
    """As its content is in the other files."""
    complete_page(folder)
    with (folder.path / PAGE).open("a") as page:
        page.write("more")
    complete_page(folder)
    assert is_as_written(folder.path, PAGE)


def test_a_page_is_not_written_into_another_run(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder was deleted and the command repeated while the page was made."""

    def replaced(*_: object, **__: object) -> str:
        summary = folder.path / "summary.json"
        summary.write_bytes(summary.read_bytes() + b"\n")
        return "the page of the deleted run"

    monkeypatch.setattr(last_page, "run_page", replaced)
    before = (folder.path / PAGE).read_text()
    complete_page(folder)
    assert (folder.path / PAGE).read_text() == before


def test_an_unfinished_run_has_no_last_page(tmp_path: Path) -> None:
    """A deleted folder is not made again."""
    with closing(begun(tmp_path / "run", tmp_path)) as folder, pytest.raises(RunError):
        complete_page(folder)
    with pytest.raises(RunError):
        complete_page(RunFolder(tmp_path / "deleted"))
    assert not (tmp_path / "deleted").exists()


@pytest.mark.parametrize("error", [UntrustedError, ValueError])
def test_a_replay_that_fails(
    error: type[Exception],
    folder: RunFolder,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The page lacks it, and a line has the reason. Without trust there is no page."""

    def fails(_: object) -> str:
        raise error("the reason")

    monkeypatch.setattr(last_page, "champion_replay", fails)
    if error is UntrustedError:
        with pytest.raises(UntrustedError):
            complete_page(folder)
        assert not is_as_written(folder.path, PAGE)
    else:
        complete_page(folder)
        assert capsys.readouterr().err == "islandgp: no replay of the best robot: the reason\n"
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
    wait_for_page(folder)
    assert is_as_written(folder.path, PAGE)


def test_the_page_of_a_stopped_run_is_not_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is short, and the command still writes to the folder."""
    folder = closed_run(tmp_path / "run", tmp_path, 3)
    monkeypatch.setattr(subprocess, "Popen", None)
    PageWriter(folder, leaves=True).end(Status.KILLED)
    assert 'data-status="KILLED"' in (folder.path / PAGE).read_text()


def configurations() -> Iterator[object]:
    """Configurations, and whether all their code is of the package."""
    yield pytest.param(plain(), True, id="default")
    yield pytest.param({**plain(), "name": "my:run", "tags": {"a": "b:c"}}, True, id="names")
    yield pytest.param({**plain(), "domain": {"factory": "mine:Robot"}}, False, id="domain")
    yield pytest.param({**plain(), "domain": {"env": "mine:Env-v1"}}, False, id="environment")


@pytest.mark.parametrize(("config", "own"), list(configurations()))
def test_code_of_the_package(config: dict[str, object], own: bool) -> None:
    """A command with other code writes the page itself, as that code may take any time."""
    assert is_own_code(config) is own
