"""Files that commands write: the whole new one or the old one, and nothing beside it."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from islandgp.atomic_files import write_atomic
from tests.trees.shell import Cli

TREE = "selector { PatrolWaypoint   PickupGarbage }  # mine\n"


@contextmanager
def full_disk() -> Iterator[None]:
    """No file can grow beyond ten bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A file that `fmt` would change, alone in its folder."""
    file = tmp_path / "mine.bt"
    file.write_text(TREE)
    return file


@pytest.mark.parametrize(
    "arguments",
    [
        ["fmt", "mine.bt"],
        ["simplify", "-", "-o", "mine.bt"],
        ["export", "-", "--to", "btcpp", "-o", "mine.bt"],
        ["replay", "-", "-o", "mine.bt", "--set", "world.episode.length=5"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_full_disk_leaves_the_file_as_it_was(
    arguments: list[str], tree: Path, islandgp: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One message, exit code 2, the old text, and no temporary file."""
    monkeypatch.chdir(tree.parent)
    with full_disk():
        result = islandgp(*arguments, stdin=TREE)
    assert result.code == 2
    assert "islandgp: Expected a place to write mine.bt, found: File too large; " in result.err
    assert tree.read_text() == TREE
    assert list(tree.parent.iterdir()) == [tree]


def test_a_failed_write_leaves_no_temporary_file(tmp_path: Path) -> None:
    """The old file is all that is there."""
    file = tmp_path / "state"
    write_atomic(file, b"old")
    with full_disk(), pytest.raises(OSError, match="File too large"):
        write_atomic(file, b"longer than ten bytes")
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


def test_links_and_permissions_stay(tree: Path, islandgp: Cli) -> None:
    """A link still leads to the file, and who may read it stays the same."""
    tree.chmod(0o640)
    link = tree.with_name("link.bt")
    link.symlink_to(tree)
    assert islandgp("fmt", link).code == 0
    assert link.is_symlink()
    assert tree.read_text() != TREE
    assert tree.stat().st_mode & 0o777 == 0o640


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everything")
def test_a_file_that_may_not_be_written_is_refused(tree: Path, islandgp: Cli) -> None:
    """A new file does not take its place."""
    tree.chmod(0o440)
    result = islandgp("fmt", tree)
    assert (result.code, tree.read_text()) == (2, TREE)
    assert "Permission denied" in result.err


def test_a_pipe_is_written_as_it_is(tree: Path, islandgp: Cli) -> None:
    """`-o >(...)` gets the text, and no file takes the pipe's place."""
    pipe = tree.with_name("pipe")
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert islandgp("simplify", tree, "-o", pipe).code == 0
        assert os.read(reader, 1000).startswith(b"PatrolWaypoint")
    finally:
        os.close(reader)
    assert pipe.is_fifo()


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("no dir/x", "no folder no dir"),
        ("mine.bt/x", "mine.bt; give another"),
        ("/proc/x", "No such file or directory"),
    ],
)
@pytest.mark.parametrize("command", [["simplify"], ["replay"], ["best"]])
def test_a_place_that_takes_no_file_is_reported_before_any_work(
    command: list[str],
    output: str,
    message: str,
    tree: Path,
    islandgp: Cli,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where what is to be worked on is not there."""
    monkeypatch.chdir(tree.parent)
    result = islandgp(*command, tree.name, "-o", output)
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith(f"islandgp: Expected a place to write {output}, found: ")
    assert message in result.err
    assert result.err.count("\n") == 1
    assert list(tree.parent.iterdir()) == [tree]


def test_a_place_that_is_tried_keeps_its_file(tree: Path, islandgp: Cli) -> None:
    """Where the work then fails, nothing has been written."""
    tree.write_text("selector {")
    other = tree.with_name("other.bt")
    other.write_text(TREE)
    assert islandgp("simplify", tree, "-o", other).code == 2
    assert (sorted(tree.parent.iterdir()), other.read_text()) == ([tree, other], TREE)
