"""What each kind of node must have besides its declaration and its closure."""

from __future__ import annotations

import re

import pytest
from hypothesis import Phase, given, settings

from islandgp.bt.core.kinds import INNER, KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, walk
from islandgp.bt.export.render import to_svg
from tests.running.commands import ROOT
from tests.strategies import few_numbers, nodes

ROWS = "".join(re.findall(r"^\| ([^|]*`[^|]*) \|", (ROOT / "docs/semantics.md").read_text(), re.M))
FEW = settings(max_examples=400, database=None, derandomize=True, phases=[Phase.generate])


def test_random_trees_have_all_kinds() -> None:
    """Properties of the engine, the printer and the analyses are tested with each kind."""
    missing = {*INNER}

    @FEW
    @given(nodes(few_numbers()))
    def collect(tree: Node) -> None:
        if found := missing & {node.kind for node in walk(tree)}:
            missing.difference_update(found)
            assert parse(to_text(tree)) == tree
            assert to_svg(tree)

    collect()
    assert not missing


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_is_documented(kind: str) -> None:
    """docs/semantics.md has a row for it."""
    assert kind == "action" or re.search(rf"`{kind}\b", ROWS)
