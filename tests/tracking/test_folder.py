"""The run's folder: what is written when, and what a resumption finds."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.errors import EvaluationError, RunError
from islandgp.records.folder import RunFolder, Status, locked
from tests.profiles import sweep
from tests.tracking.folders import about, begun, closed_run, steps


def test_status_is_read_from_the_folder(tmp_path: Path) -> None:
    """At work, stopped, failed, finished: after any end of the process."""
    folder = begun(tmp_path / "one", tmp_path)
    assert RunFolder(folder.path).status() is Status.RUNNING
    folder.close()
    assert folder.status() is Status.KILLED
    folder.fail(EvaluationError("trouble"))
    assert folder.status() is Status.FAILED
    assert closed_run(tmp_path / "two", tmp_path).status() is Status.FINISHED


@pytest.mark.slow
def test_one_process_writes_at_a_time(tmp_path: Path) -> None:
    """A second one is refused, and a remedy named; after the first has closed it may."""
    folder = begun(tmp_path / "one", tmp_path)
    with pytest.raises(RunError, match=r"found another run at work.*name=\.\.\."):
        RunFolder(folder.path).open("", about("one", tmp_path))
    folder.close()
    assert not locked(folder.path / ".lock")


def test_an_error_is_forgotten_when_the_run_goes_on(tmp_path: Path) -> None:
    """`error.txt` has the reason why a run is stopped, not an earlier one."""
    folder = closed_run(tmp_path / "one", tmp_path, 2)
    folder.fail(EvaluationError("trouble"))
    begun(folder.path, tmp_path).close()
    assert folder.error() == ""


def test_an_error_has_its_message_first_and_then_its_origin(tmp_path: Path) -> None:
    """One line has the reason; the file holds the traceback too."""
    folder = RunFolder(tmp_path)
    folder.fail(EvaluationError("Expected an outcome, found trouble."))
    assert folder.reason() == "Expected an outcome, found trouble."
    assert "islandgp.errors.EvaluationError: Expected an outcome" in folder.error()


@pytest.mark.parametrize("torn", [b"", b'{"half":', b'{"a whole":"line"}\n{"half'])
def test_what_was_written_after_the_checkpoint_is_cut_off(tmp_path: Path, torn: bytes) -> None:
    """However a process died, the next one starts from whole lines up to the checkpoint."""
    folder = closed_run(tmp_path / "one", tmp_path, 3)
    file = folder.path / "generations.jsonl"
    content = file.read_bytes()
    file.write_bytes(content + torn)
    state = folder.resume()
    assert state is not None
    assert state.generation == 3
    assert file.read_bytes() == content


def test_a_finished_run_is_not_cut(tmp_path: Path) -> None:
    """It has no checkpoint, so that a resumption would keep none of its records."""
    folder = closed_run(tmp_path / "one", tmp_path)
    before = (folder.path / "generations.jsonl").read_bytes()
    with pytest.raises(RunError, match=r"found it finished; use resume=never"):
        folder.resume()
    assert (folder.path / "generations.jsonl").read_bytes() == before


def test_settled_generations_follow_the_checkpoint(tmp_path: Path) -> None:
    """None at first, then as many as the checkpoint has behind it, then all."""
    folder = begun(tmp_path / "one", tmp_path)
    assert folder.completed_generations() == 0
    folder.append(steps()[0])
    assert folder.completed_generations() == 1
    folder.close()
    assert closed_run(tmp_path / "two", tmp_path).completed_generations() == 5


def test_a_line_that_is_being_written_is_not_read(tmp_path: Path) -> None:
    """A reader beside the run sees whole lines only."""
    folder = closed_run(tmp_path / "one", tmp_path, 2)
    with (folder.path / "generations.jsonl").open("ab") as file:
        file.write(b'{"snap')
    assert len(list(folder.records())) == 2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", r"checkpoint\.json, found a damaged file"),
        (None, r"Expected a checkpoint beside 4 generations.*resume=never"),
    ],
)
def test_a_damaged_or_missing_checkpoint_is_an_error(
    content: str | None, message: str, tmp_path: Path
) -> None:
    """Nothing is cut: beginning again would cut all generations off."""
    folder = closed_run(tmp_path / "one", tmp_path, 4)
    records = (folder.path / "generations.jsonl").read_bytes()
    if content is None:
        (folder.path / "checkpoint.json").unlink()
    else:
        (folder.path / "checkpoint.json").write_text(content)
    with pytest.raises(RunError, match=message):
        folder.resume()
    assert (folder.path / "generations.jsonl").read_bytes() == records


def test_a_run_without_a_checkpoint_begins_again(tmp_path: Path) -> None:
    """A process may die between the first record and the first checkpoint."""
    folder = closed_run(tmp_path / "one", tmp_path, 1)
    (folder.path / "checkpoint.json").unlink()
    assert folder.resume() is None
    assert list(folder.records()) == list(folder.costs()) == []


@pytest.mark.parametrize("end", [-1, -200])
def test_a_record_that_is_cut_is_an_error(end: int, tmp_path: Path) -> None:
    """The last line without its end is not taken for a record."""
    folder = closed_run(tmp_path / "one", tmp_path, 4)
    file = folder.path / "generations.jsonl"
    file.write_bytes(file.read_bytes()[:end])
    with pytest.raises(RunError, match="Expected 4 generations"):
        folder.resume()


@sweep("generation", (0, 1, 3, 2), quick=2)
def test_every_edited_digit_of_a_record_is_noticed(generation: int, tmp_path: Path) -> None:
    """It is an error that names the file."""
    folder = closed_run(tmp_path / "one", tmp_path, 4)
    file = folder.path / "generations.jsonl"
    records = file.read_bytes().splitlines(keepends=True)
    digits = [at for at, byte in enumerate(records[generation]) if byte in b"0123456789"]
    for at in digits[:: len(digits) // 20]:
        line = bytearray(records[generation])
        line[at] = ord("1") if line[at] != ord("1") else ord("2")
        file.write_bytes(b"".join([*records[:generation], line, *records[generation + 1 :]]))
        named = "a record before generation 4 differs from its checksum"
        with pytest.raises(RunError, match=named):
            folder.resume()


def test_records_in_another_order_are_noticed(tmp_path: Path) -> None:
    """Each checksum vouches for the records before it as well."""
    folder = closed_run(tmp_path / "one", tmp_path, 4)
    file = folder.path / "generations.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    for order in ((1, 0, 2, 3), (0, 0, 2, 3), (0, 2, 1, 3)):
        file.write_bytes(b"".join(lines[i] for i in order))
        with pytest.raises(RunError, match="differs from its checksum"):
            folder.resume()


def test_the_best_tree_is_made_again(tmp_path: Path) -> None:
    """Where it is missing in an unfinished run."""
    folder = closed_run(tmp_path / "one", tmp_path, 4)
    best = folder.path / "best.bt"
    before = best.read_bytes()
    best.unlink()
    folder.resume()
    assert best.read_bytes() == before


def test_what_a_stopped_machine_left_is_cleared_away(tmp_path: Path) -> None:
    """Temporary files, when the run goes on."""
    folder = closed_run(tmp_path / "one", tmp_path, 2)
    for name in (".checkpoint.json.17.tmp", ".costs.jsonl.18.tmp", ".other.json.19.tmp"):
        (folder.path / name).write_text("half")
    begun(folder.path, tmp_path).close()
    assert [file.name for file in folder.path.glob("*.tmp")] == []
