"""Checkpoints: the same state comes back, and a damaged file is never taken for one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.atomic_files import write_atomic
from islandgp.errors import RunError
from islandgp.evolution.loop import initial_state
from islandgp.evolution.search_calls import restored
from islandgp.gp.record import RunState
from islandgp.records.checkpoint import read_checkpoint, save_state
from islandgp.search.paper import Paper
from tests.evolution.runs import Constant, lines, plan, run
from tests.profiles import examples


@pytest.fixture(scope="module")
def states() -> list[RunState]:
    """All states of a run, the first one included."""
    steps = run(supervisor=Constant(0.5))
    return [
        initial_state(plan(), Paper(plan())),
        *(step.state for step in steps if step.state is not None),
    ]


@pytest.fixture(scope="module")
def saved(states: list[RunState], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a run's last state."""
    path = tmp_path_factory.mktemp("run") / "checkpoint.json"
    save_state(path, states[-1])
    return path


def test_round_trip(states: list[RunState], tmp_path: Path) -> None:
    """What is read equals what was written, and no other file is left behind."""
    path = tmp_path / "checkpoint.json"
    for state in states:
        save_state(path, state)
        checkpoint, records = read_checkpoint(path)
        assert restored(checkpoint, Paper(plan()), plan().vocabulary) == replace(state, history=())
        assert records == ""
    assert [file.name for file in tmp_path.iterdir()] == ["checkpoint.json"]


def test_the_same_bytes(saved: Path, tmp_path: Path) -> None:
    """Writing a state that was read gives the same file."""
    copy = tmp_path / "again.json"
    save_state(copy, read_checkpoint(saved)[0])
    assert copy.read_bytes() == saved.read_bytes()


def test_a_checkpoint_does_not_grow(states: list[RunState], tmp_path: Path) -> None:
    """It holds no generation but the next one: the others are in the records."""
    path = tmp_path / "checkpoint.json"
    last = states[-1]
    save_state(path, last)
    short = path.stat().st_size
    save_state(path, replace(last, history=last.history * 100))
    assert path.stat().st_size == short


def test_resume_through_the_file(states: list[RunState], tmp_path: Path) -> None:
    """A run that goes on from its file ends in the same bytes as one in one go."""
    expected = list(lines(run(supervisor=Constant(0.5))))
    for state in states:
        save_state(tmp_path / "checkpoint.json", state)
        checkpoint, _ = read_checkpoint(tmp_path / "checkpoint.json")
        start = replace(checkpoint, history=state.history)
        resumed = run(supervisor=Constant(0.5), start=start)
        assert list(lines(resumed)) == expected[state.generation :]


@examples(max_examples=150)
@given(data=st.data())
def test_one_wrong_byte(saved: Path, data: st.DataObject) -> None:
    """A file with any one byte changed or any end missing is refused by its path."""
    content = saved.read_bytes()
    at = data.draw(st.integers(0, len(content) - 2))
    if data.draw(st.booleans()):
        broken = content[:at]
    else:
        byte = data.draw(st.integers(0, 255).filter(lambda b: b != content[at]))
        broken = content[:at] + bytes([byte]) + content[at + 1 :]
    path = saved.with_name("broken.json")
    path.write_bytes(broken)
    with pytest.raises(RunError, match=r"broken\.json.*delete the run's folder or use resume="):
        read_checkpoint(path)


@pytest.mark.parametrize(
    "text", ["", "null", "[]", "{}", '{"state": 1}', '{"state": [], "sha256": 3}']
)
def test_files_that_are_no_checkpoint(tmp_path: Path, text: str) -> None:
    """A file of something else is no checkpoint."""
    path = tmp_path / "checkpoint.json"
    path.write_text(text)
    with pytest.raises(RunError, match="found a damaged file"):
        read_checkpoint(path)


def test_write_atomic_keeps_the_old_file(tmp_path: Path) -> None:
    """A write that fails leaves the old file as it was."""
    path = tmp_path / "file"
    write_atomic(path, b"old")
    with pytest.raises(TypeError):
        write_atomic(path, "not bytes")  # type: ignore[arg-type]
    assert path.read_bytes() == b"old"
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"
