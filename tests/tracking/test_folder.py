"""The run's folder: what is written when, and what a resumption finds."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.errors import EvaluationError, RunError
from islandgp.tracking.folder import RunFolder, Status, locked
from tests.tracking.folders import about, begun, steps, written


def test_status_is_read_from_the_folder(tmp_path: Path) -> None:
    """At work, stopped, failed, finished: whatever became of the process."""
    folder = begun(tmp_path / "one", tmp_path)
    assert RunFolder(folder.path).status() is Status.RUNNING
    folder.close()
    assert folder.status() is Status.KILLED
    folder.fail(EvaluationError("trouble"))
    assert folder.status() is Status.FAILED
    assert written(tmp_path / "two", tmp_path).status() is Status.FINISHED


def test_one_process_writes_at_a_time(tmp_path: Path) -> None:
    """A second one is refused, and a remedy named; after the first has closed it may."""
    folder = begun(tmp_path / "one", tmp_path)
    with pytest.raises(RunError, match=r"found another run at work.*name=\.\.\."):
        RunFolder(folder.path).open("", about("one", tmp_path))
    folder.close()
    assert not locked(folder.path / ".lock")


def test_an_error_is_forgotten_when_the_run_goes_on(tmp_path: Path) -> None:
    """`error.txt` tells why a run stands still, not what once happened."""
    folder = written(tmp_path / "one", tmp_path, 2)
    folder.fail(EvaluationError("trouble"))
    begun(folder.path, tmp_path).close()
    assert folder.error() == ""


def test_an_error_has_its_message_first_and_then_its_origin(tmp_path: Path) -> None:
    """One line says why; the file holds the traceback too."""
    folder = RunFolder(tmp_path)
    folder.fail(EvaluationError("Expected an outcome, found trouble."))
    assert folder.reason() == "Expected an outcome, found trouble."
    assert "islandgp.errors.EvaluationError: Expected an outcome" in folder.error()


def test_a_fault_of_the_program_is_told_by_its_last_line(tmp_path: Path) -> None:
    """A traceback's first line says nothing."""
    folder = RunFolder(tmp_path)
    try:
        _ = 1 / 0
    except ZeroDivisionError as error:
        folder.fail(error)
    assert folder.reason() == "ZeroDivisionError: division by zero"


@pytest.mark.parametrize("torn", [b"", b'{"half":', b'{"a whole":"line"}\n{"half'])
def test_what_was_written_after_the_checkpoint_is_cut_off(tmp_path: Path, torn: bytes) -> None:
    """However a process died, the next one starts from whole lines up to the checkpoint."""
    folder = written(tmp_path / "one", tmp_path, 3)
    file = folder.path / "generations.jsonl"
    whole = file.read_bytes()
    file.write_bytes(whole + torn)
    state = folder.resume()
    assert state is not None
    assert state.generation == 3
    assert file.read_bytes() == whole


def test_a_finished_run_is_not_cut(tmp_path: Path) -> None:
    """It has no checkpoint, so that a resumption would keep none of its records."""
    folder = written(tmp_path / "one", tmp_path)
    before = (folder.path / "generations.jsonl").read_bytes()
    with pytest.raises(RunError, match=r"found it finished; use resume=never"):
        folder.resume()
    assert (folder.path / "generations.jsonl").read_bytes() == before


def test_a_record_that_is_missing_before_the_checkpoint_is_an_error(tmp_path: Path) -> None:
    """Going on would leave a gap in the records, so it is refused."""
    folder = written(tmp_path / "one", tmp_path, 3)
    file = folder.path / "generations.jsonl"
    file.write_bytes(file.read_bytes().splitlines(keepends=True)[0])
    with pytest.raises(RunError, match="Expected 3 generations"):
        folder.resume()


def test_a_run_of_an_older_version_goes_on(tmp_path: Path) -> None:
    """Records that hold more than today's are read as today's."""
    folder = written(tmp_path / "one", tmp_path, 3)
    before = folder.resume()
    file = folder.path / "generations.jsonl"
    old = file.read_bytes().replace(b'"doing":', b'"charging":4,"clearing":4,"doing":')
    file.write_bytes(old)
    assert folder.resume() == before
    assert file.read_bytes() == old


@pytest.mark.parametrize("line", [b"{}", b'{"snapshot": 3}', b'{"snap', b'{"snapshot": {"a": 1}}'])
def test_a_damaged_record_before_the_checkpoint_is_an_error(tmp_path: Path, line: bytes) -> None:
    """The run's history is read from its records, so they are checked like the checkpoint."""
    folder = written(tmp_path / "one", tmp_path, 3)
    file = folder.path / "generations.jsonl"
    first, _, third = file.read_bytes().splitlines()
    file.write_bytes(b"\n".join((first, line, third)) + b"\n")
    with pytest.raises(RunError, match=r"generations\.jsonl, found a damaged file"):
        folder.resume()


def test_settled_generations_follow_the_checkpoint(tmp_path: Path) -> None:
    """None at first, then as many as the checkpoint has behind it, then all."""
    folder = begun(tmp_path / "one", tmp_path)
    assert folder.settled() == 0
    folder.append(steps()[0])
    assert folder.settled() == 1
    folder.close()
    assert written(tmp_path / "two", tmp_path).settled() == 5


def test_a_line_that_is_being_written_is_not_read(tmp_path: Path) -> None:
    """A reader beside the run sees whole lines only."""
    folder = written(tmp_path / "one", tmp_path, 2)
    with (folder.path / "generations.jsonl").open("ab") as file:
        file.write(b'{"snap')
    assert len(list(folder.records())) == 2
