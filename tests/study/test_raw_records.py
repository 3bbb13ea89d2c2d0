"""`docs/raw_records.py`: what it publishes of a sweep is complete, checked and free of folders."""

from __future__ import annotations

import tarfile
from pathlib import Path

import pytest

import islandgp
from islandgp.commands.verify_command import Soundness, verify
from islandgp.records.folder import RunFolder
from tests.site.generators import script

RUN = ("domain=cartpole", "name=sweep", "gp.population=6", "gp.generations=2", "tracking=off")


def test_the_packed_records_are_verified_and_read_as_a_run(tmp_path: Path) -> None:
    """Unpacked elsewhere, a run is complete and has the same records; no folder is in the file."""
    raw = script("raw_records")
    for seed in (1, 2):
        islandgp.run(*RUN, f"seed={seed}", f"runs={tmp_path / 'here'}", "progress=off")
    sweep = tmp_path / "here" / "sweep"
    archive = tmp_path / "out" / "records.tar.xz"
    assert raw.pack(sweep, archive) == 2
    with tarfile.open(archive) as tar:
        for entry in tar:  # extractall has its filter only since Python 3.11.4
            target, data = tmp_path / "there" / entry.name, tar.extractfile(entry)
            assert data is not None
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data.read())
    for run in sweep.iterdir():
        copy = tmp_path / "there" / "sweep" / run.name
        assert islandgp.load(copy).generations.equals(islandgp.load(run).generations)
        assert verify(RunFolder(copy))[0] is Soundness.VERIFIED
        assert str(tmp_path) not in (copy / "about.json").read_text()


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="found no finished run"):
        script("raw_records").pack(tmp_path, tmp_path / "records.tar.xz")
    assert [*tmp_path.iterdir()] == []
