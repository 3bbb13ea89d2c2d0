"""The commit of a checkout in a run's tags."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from islandgp.running.resume import _commit


@pytest.mark.process
@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_the_commit_is_read_without_writing_to_the_repository(tmp_path: Path) -> None:
    """Where git wrote its index, a disk limit would leave index.lock behind."""

    def git(*arguments: str) -> None:
        identity = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        subprocess.run(
            ["git", *identity, *arguments], cwd=tmp_path, check=True, capture_output=True
        )

    file = tmp_path / "file"
    file.write_text("one")
    git("init")
    git("add", ".")
    git("commit", "-m", "one")
    os.utime(file, (1, 1))  # git would write the new time into its index
    index = tmp_path / ".git" / "index"
    before = index.read_bytes()
    commit = _commit(tmp_path)
    assert len(commit) == 12
    file.write_text("two")
    assert _commit(tmp_path) == f"{commit}-dirty"
    assert index.read_bytes() == before
    assert _commit(tmp_path / "nowhere") == ""
