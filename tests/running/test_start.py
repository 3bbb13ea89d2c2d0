"""The first trees of generation 0 that `start=FILE.bt` gives."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Limits
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import ConfigError, IslandError, TreeError
from islandgp.running.start import start_digest, start_trees


@pytest.mark.parametrize(
    ("text", "nodes", "error", "message"),
    [
        ("PatrolWaypoint", 1, None, ""),
        ("selector { PatrolWaypoint ExecuteCharge }", 2, ConfigError, "at most 2 nodes"),
        ("Fly", 9, TreeError, "Fly"),
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
    assert start_digest(str(file)) not in {first, start_digest(None)}
