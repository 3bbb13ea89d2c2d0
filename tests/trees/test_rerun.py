"""`--rerun`: check and play again when a file changes."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from islandgp.commands import rerun
from tests.trees.shell import Cli

GOOD = "sequence { PatrolWaypoint }\n"


def save(file: Path, text: str) -> None:
    """Writes a file with a new time, also within a tick of the file system's clock."""
    before = file.stat().st_mtime_ns if file.exists() else 0
    file.write_text(text)
    os.utime(file, ns=(before + 10**9, before + 10**9))


def looks(monkeypatch: pytest.MonkeyPatch, *steps: Callable[[], object]) -> None:
    """Between looks at the files one step after the other happens; then Ctrl-C."""
    remaining = list(steps)

    def sleep(_: float) -> None:
        if not remaining:
            raise KeyboardInterrupt
        remaining.pop(0)()

    monkeypatch.setattr(rerun.time, "sleep", sleep)


def test_check_runs_again(islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At each change of the file or of what it includes, with any errors in them."""
    file, library = tmp_path / "my tree.bt", tmp_path / "lib.bt"
    file.write_text(GOOD)
    looks(
        monkeypatch,
        lambda: None,
        lambda: save(file, "sequence { PatrolWaypont }\n"),
        lambda: save(file, 'include "lib.bt"\nuse go\n'),
        lambda: save(library, "subtree go = SeekCharger\n"),
        file.unlink,
        lambda: save(file, GOOD * 2),
        lambda: save(file, GOOD),
    )
    result = islandgp("check", "--rerun", file)
    assert result.code == 130
    parts = [part.strip().split("\n", 1)[-1] for part in result.out.split("\n\n")]
    assert "2 nodes, depth 2, no warnings" in parts[0]
    assert "Did you mean PatrolWaypoint?" in parts[1]
    assert "there is no file 'lib.bt'" in parts[2]
    assert "1 node, depth 1, no warnings" in parts[3]
    assert "a file holds one tree" in parts[4]
    assert "2 nodes, depth 2, no warnings" in parts[5]
    assert len(parts) == 6


def test_play_runs_again(islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An error is reported, and the next change runs it again."""
    file = tmp_path / "tree.bt"
    file.write_text(GOOD)
    looks(monkeypatch, lambda: save(file, "sequence {"), lambda: save(file, "SeekCharger"))
    result = islandgp("play", "--rerun", file, "--seeds", 1, "--set", "world.episode.length=5")
    assert result.code == 130
    assert result.out.count("of 1 world:") == 2
    assert "the text ends too early" in result.err


def test_only_files(islandgp: Cli) -> None:
    """The standard input does not change."""
    result = islandgp("check", "--rerun", "-", stdin=GOOD)
    assert result.code == 2
    assert "expected files for --rerun" in result.err
