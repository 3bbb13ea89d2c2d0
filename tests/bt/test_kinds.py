"""What each kind of node must have besides its declaration and its closure."""

from __future__ import annotations

import re

import pytest
from hypothesis import Phase, find, settings

from islandgp.bt.core.kinds import INNER, KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import walk
from islandgp.bt.export.render import to_svg
from tests.running.commands import ROOT
from tests.strategies import few_numbers, nodes

ROWS = "".join(re.findall(r"^\| ([^|]*`[^|]*) \|", (ROOT / "docs/semantics.md").read_text(), re.M))
SMALL = settings(phases=[Phase.generate], max_examples=5000, database=None, derandomize=True)


@pytest.mark.parametrize("kind", INNER)
def test_random_trees_have_all_kinds(kind: str) -> None:
    """Properties of the engine, the printer and the analyses are tested with each kind."""
    tree = find(
        nodes(few_numbers()), lambda t: any(n.kind == kind for n in walk(t)), settings=SMALL
    )
    assert parse(to_text(tree)) == tree
    assert to_svg(tree)


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_documented(kind: str) -> None:
    """docs/semantics.md has a row for it."""
    assert kind == "action" or re.search(rf"`{kind}\b", ROWS)
