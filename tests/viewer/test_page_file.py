"""The file of a run's page: when it is written, and what it never replaces."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from click.testing import CliRunner

from islandgp.cli import islandgp
from islandgp.commands import runs as run_commands
from islandgp.errors import RunError, UntrustedError
from islandgp.records.files import PAGE
from islandgp.records.folder import RunFolder, Status
from islandgp.records.manifest import damaged_files
from islandgp.viewer import run_page as page_file
from islandgp.viewer.run_page import write_page
from tests.tracking.folders import archive, begun, closed_run, finished, steps


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    """A finished run whose page is that of the unfinished run, as after a kill."""
    folder = closed_run(tmp_path / "run", tmp_path)
    write_page(folder, Status.RUNNING)
    return folder


def test_a_page_is_completed_once(folder: RunFolder) -> None:
    """It is no damage, and has the same bytes whoever writes it."""
    write_page(folder, Status.FINISHED)
    text = (folder.path / PAGE).read_text()
    assert 'data-status="FINISHED"' in text
    assert not damaged_files(folder.path)
    write_page(folder, Status.FINISHED)
    assert (folder.path / PAGE).read_text() == text


def test_a_file_that_a_killed_process_left_is_removed(folder: RunFolder) -> None:
    """When the page is completed."""
    (folder.path / ".run.html.17.tmp").write_text("half")
    write_page(folder, Status.FINISHED)
    assert not [*folder.path.glob(".*.tmp")]


def test_a_page_is_not_written_into_another_run(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder was deleted and the command repeated while the page was made."""

    def replaced(*_: object, **__: object) -> str:
        summary = folder.path / "summary.json"
        summary.write_bytes(summary.read_bytes() + b"\n")
        return "the page of the deleted run"

    monkeypatch.setattr(page_file, "run_page", replaced)
    before = (folder.path / PAGE).read_text()
    write_page(folder, Status.FINISHED)
    assert (folder.path / PAGE).read_text() == before


def test_an_unfinished_run_has_no_last_page(tmp_path: Path) -> None:
    """A deleted folder is not made again."""
    with closing(begun(tmp_path / "run", tmp_path)) as folder, pytest.raises(RunError):
        write_page(folder, Status.FINISHED)
    with pytest.raises(RunError):
        write_page(RunFolder(tmp_path / "deleted"), Status.FINISHED)
    assert not (tmp_path / "deleted").exists()


@pytest.mark.parametrize("error", [UntrustedError, ValueError])
def test_a_replay_that_fails(
    error: type[Exception],
    folder: RunFolder,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The page lacks it, and a line has the reason."""

    def fails(*_: object) -> str:
        raise error("the reason")

    monkeypatch.setattr(page_file, "champion_replay", fails)
    write_page(folder, Status.FINISHED)
    assert capsys.readouterr().err == "islandgp: no replay of the best robot: the reason\n"
    assert not damaged_files(folder.path)


@pytest.mark.parametrize("finishes", [True, False])
def test_watch_renews_the_page_of_an_active_run(
    finishes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Until the run has ended; a browser that shows it reloads it meanwhile."""
    folder, pages = begun(tmp_path / "run", tmp_path), list[str]()

    def time_passes(_: float) -> None:
        pages.append((folder.path / PAGE).read_text())
        if len(pages) < 3:
            folder.append(steps()[len(pages)])
            return
        if finishes:
            for step in steps()[3:]:
                folder.append(step)
            folder.finish(finished(folder, steps()[-1]), archive(steps()[-1]))
        folder.close()

    monkeypatch.setattr(run_commands, "sleep", time_passes)
    folder.append(steps()[0])
    result = CliRunner().invoke(islandgp, ["watch", str(folder.path), "--no-open"])
    assert result.output == f"{folder.path / PAGE}\n"
    assert len(set(pages)) == 3
    assert all('data-status="RUNNING"' in page for page in pages)
    status = "FINISHED" if finishes else "KILLED"
    assert f'data-status="{status}"' in (folder.path / PAGE).read_text()
