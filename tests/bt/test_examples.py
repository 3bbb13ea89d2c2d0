"""The trees in grammar/examples: the documentation shows them, so they must be right."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from islandgp.bt.core.condition import terms
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, check_limits, depth, guard_of, size, walk
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.resources import resource

EXAMPLES = sorted((resource("grammar") / "examples").glob("*.bt"))
PAPER = Limits(max_depth=8, max_nodes=50)  # section 2.2.3


def tree(name: str) -> str:
    return (resource("grammar") / "examples" / f"{name}.bt").read_text(encoding="utf-8")


def test_there_is_an_example_for_each_row_of_table_7() -> None:
    """One tree for each row of Table 7, and more: good, poor, of one behaviour, after Figure 9."""
    assert [path.stem for path in EXAMPLES] == [
        "all_rounder",
        "charging_focused",
        "clearing_focused",
        "diverse",
        "diverse_compact",
        "humanoid_focused",
        "multi_behaviour",
        "paper_fig9",
        "pickup_specialist",
        "poor",
        "rare_category",
        "single_charging",
        "single_clearing",
        "single_humanoid",
        "single_pickup",
    ]


@pytest.mark.parametrize("behaviour", ["pickup", "humanoid", "charging", "clearing"])
def test_single_behaviours_are_as_small_as_the_paper_asks(behaviour: str) -> None:
    """8 to 10 nodes and a depth of 4 (section 2.4.6)."""
    root = parse(tree(f"single_{behaviour}"))
    assert 8 <= size(root) <= 10
    assert depth(root) <= 4


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path: Path) -> None:
    """It parses, keeps the paper's limits, and is as large as its comment states."""
    text = path.read_text(encoding="utf-8")
    parsed = parse(text, VOCABULARY, name=path.name)
    check_limits(parsed, PAPER)
    assert parse(to_text(parsed)) == parsed
    stated = re.search(r"^# (\d+) nodes, depth (\d+)\.$", text, re.MULTILINE)
    assert stated is not None
    assert (size(parsed), depth(parsed)) == (int(stated[1]), int(stated[2]))
    assert all(len(line) <= 80 for line in text.splitlines())


def test_figure_9() -> None:
    """22 nodes, depth 5: a selector of four guarded sequences (section 3.10)."""
    root = parse(tree("paper_fig9"))
    assert (size(root), depth(root)) == (22, 5)
    assert root.kind == "selector"
    assert [branch.kind for branch in root.children] == ["when"] * 4
    assert [branch.children[0].kind for branch in root.children] == ["sequence"] * 4


def test_diverse_shows_everything() -> None:
    """The diverse tree has every kind of node and asks for every key."""
    nodes = list(walk(parse(tree("diverse"))))
    assert {node.kind for node in nodes} == {name for name, kind in KINDS.items() if kind.paper}
    conditions = [guard_of(node).condition for node in nodes if node.guard]
    assert {term.key for each in conditions for term in terms(each)} == set(VOCABULARY.keys)


def test_charging_is_not_cut_short() -> None:
    """Wherever a good example charges on a low battery, the guard can't stop the charging."""
    for path in EXAMPLES:
        for node in walk(parse(path.read_text(encoding="utf-8"))):
            if node.guard and guard_of(node).condition[:2] == ("batteryLevel", "<"):
                assert (node.args[1] in ("lower", "none")) == (path.stem != "poor")
