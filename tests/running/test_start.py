"""The first trees of generation 0 with `start=FILE.bt` and `start=RUN`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Limits
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import ConfigError, IslandError, TreeError
from islandgp.gp.archive import Elite
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.manifest import REQUIRED, write_manifest
from islandgp.running.parts import start_digest, start_trees


@pytest.mark.parametrize(
    ("text", "nodes", "error", "message"),
    [
        ("PatrolWaypoint", 1, None, ""),
        ("selector { PatrolWaypoint ExecuteCharge }", 2, ConfigError, "exceeds gp.max_depth"),
        ("Fly", 9, TreeError, "Fly"),
        (
            "parallel { PatrolWaypoint SeekCharger }",
            9,
            ConfigError,
            "both use base",
        ),
        (None, 9, IslandError, "Expected to read"),
    ],
)
def test_a_run_starts_from_a_file(
    text: str | None, nodes: int, error: type[Exception] | None, message: str, tmp_path: Path
) -> None:
    """Its tree, if it is of the domain and within the limits; else one message."""
    file = tmp_path / "my.bt"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    if error is None:
        assert start_trees(str(file), VOCABULARY, Limits(9, nodes), 5) == (parse(text or ""),)
        return
    with pytest.raises(error, match=message):
        start_trees(str(file), VOCABULARY, Limits(9, nodes), 5)


def test_the_digest_of_a_start_covers_included_files(tmp_path: Path) -> None:
    """Comments do not change it, an included subtree does."""
    file, library = tmp_path / "my.bt", tmp_path / "lib.bt"
    file.write_text('include "lib.bt"\nselector { use go }', encoding="utf-8")
    library.write_text("subtree go = PatrolWaypoint", encoding="utf-8")
    first = start_digest(str(file))
    library.write_text("subtree go = PatrolWaypoint # a comment", encoding="utf-8")
    assert start_digest(str(file)) == first
    library.write_text("subtree go = ExecuteCharge", encoding="utf-8")
    assert start_digest(str(file)) not in {first, ""}


def test_trees_of_an_archive_that_are_too_large_are_left_out(tmp_path: Path) -> None:
    """One line has their number and a reason; without such trees there is none."""
    trees = ("PatrolWaypoint", "selector { PatrolWaypoint ExecuteCharge }")
    elites = tuple(Elite((k,), f"0.{k}", tree, 0, 1, 9.0, 1) for k, tree in enumerate(trees))
    archive = ArchiveFile("island", {"pickups": (1.0, 2.0)}, 0.0, 1.0, 18.0, elites)
    (tmp_path / "archive.json").write_bytes(archive.to_bytes())
    for name in REQUIRED:
        (tmp_path / name).touch()
    write_manifest(tmp_path, b"")
    lines: list[str] = []
    start = partial(start_trees, str(tmp_path), VOCABULARY, most=5, warn=lines.append)
    assert start(limits=Limits(9, 1)) == (parse("PatrolWaypoint"),)
    (line,) = lines
    assert "1 of 2 trees are left out, the first because it exceeds gp.max_depth" in line
    assert len(start(limits=Limits(9, 9))) == 2
    assert len(lines) == 1
