"""The example trees by name: which file a supervisor's tree is."""

from __future__ import annotations

from functools import cache

from islandgp.bt.language import parse, to_text
from islandgp.resources import resource


@cache
def library() -> dict[str, str]:
    """The names of the trees in `grammar/examples`, by their canonical text."""
    files = sorted((resource("grammar") / "examples").glob("*.bt"))
    return {to_text(parse(f.read_text(encoding="utf-8"), name=str(f))): f.stem for f in files}
