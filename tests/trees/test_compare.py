"""`islandgp diff`: what changed between two trees, node by node."""

from __future__ import annotations

from pathlib import Path
from random import Random
from time import process_time

import pytest
from hypothesis import given

from islandgp.bt.analysis.compare import Mark, compare
from islandgp.bt.core.node import Node, leaf, selector, walk
from tests.bt.stage import short_tree
from tests.profiles import examples
from tests.strategies import few_numbers, nodes
from tests.trees.shell import Cli

TREES = nodes(few_numbers(), max_leaves=8)


def marked(old: str, new: str) -> str:
    return "".join(line.mark for line in compare(short_tree(old), short_tree(new)))


@examples(max_examples=150)
@given(old=TREES, new=TREES)
def test_both_trees_are_listed_in_order(old: Node, new: Node) -> None:
    """The lines without + are the old tree's nodes in order, those without - the new one's."""
    lines = compare(old, new)
    assert [(n.kind, n.args) for n in walk(old)] == [
        (line.old.kind, line.old.args) for line in lines if line.old is not None
    ]
    assert [(n.kind, n.args) for n in walk(new)] == [
        (line.new.kind, line.new.args) for line in lines if line.new is not None
    ]
    for line in lines:
        missing = (line.old is None, line.new is None)
        assert missing == (line.mark is Mark.INSERTED, line.mark is Mark.DELETED)


@examples(max_examples=150)
@given(old=TREES, new=TREES)
def test_equal_trees_have_no_marks(old: Node, new: Node) -> None:
    """And only those."""
    assert {line.mark for line in compare(old, old)} == {Mark.SAME}
    assert (old == new) == ({line.mark for line in compare(old, new)} == {Mark.SAME})


def test_by_hand() -> None:
    """A guard around a branch is one insertion, another number one change in place."""
    assert marked("selector { A B }", "selector { A B }") == "   "
    assert marked("selector { A B }", "selector { A when p { B } }") == "  + "
    assert marked("selector { A when p { B } }", "selector { A B }") == "  - "
    assert marked("when x < 1 { A }", "when x < 2 { A }") == "~ "
    assert marked("selector { A B }", "sequence { A B }") == "~  "
    assert marked("selector { A B D }", "selector { A D }") == "  - "
    assert marked("selector { A B }", "selector { A D }") == "  ~"
    assert marked("selector { sequence { A B } D }", "selector { A D }") == " - - "


def test_moved_nodes() -> None:
    """A node that is below another node than before is changed."""
    assert marked("selector { sequence { A } B D }", "selector { sequence { A B D } }") == "   ~~"


def test_command(islandgp: Cli, tmp_path: Path) -> None:
    """Exit code 0 and one line for equal trees, 1 and the changes for others."""
    a, b, c = (tmp_path / f"{name}.bt" for name in "abc")
    a.write_text("selector { SeekCharger PatrolWaypoint }  # a comment")
    b.write_text("subtree s = SeekCharger selector { use s PatrolWaypoint }")
    c.write_text("selector { SeekCharger PatrolWaypoint MoveToGarbage }")
    same = islandgp("diff", a, b)
    assert (same.code, same.out) == (0, "The same tree.\n")
    other = islandgp("diff", a, c)
    assert other.code == 1
    assert other.out.splitlines() == [
        "+   MoveToGarbage  # 1",
        "0 deleted, 1 inserted, 0 changed",
    ]


def test_values_of_constants_and_arguments(islandgp: Cli, tmp_path: Path) -> None:
    """A change of a constant or an argument shows both values."""
    a, b = (tmp_path / f"{name}.bt" for name in "ab")
    text = (
        "constant low = {}\n"
        "subtree s(key, level, work) = when key < level {{ work }}\n"
        "selector {{ use s(batteryLevel, low, {}) use s(lap, {}, PatrolWaypoint) }}\n"
    )
    a.write_text(text.format(20, "SeekCharger", 1))
    b.write_text(text.format(25, "ExecuteCharge", 2))
    assert islandgp("diff", a, b).out.splitlines() == [
        "~   \N{WHITE DIAMOND} batteryLevel < 20 -> \N{WHITE DIAMOND} batteryLevel < 25  # 2",
        "~     SeekCharger -> ExecuteCharge  # 3",
        "~   \N{WHITE DIAMOND} lap < 1 -> \N{WHITE DIAMOND} lap < 2  # 2",
        "0 deleted, 0 inserted, 3 changed",
    ]


@pytest.mark.slow
def test_large_trees(islandgp: Cli, tmp_path: Path) -> None:
    """Frequent nodes of a large tree make nobody wait."""
    a, b = tmp_path / "a.bt", tmp_path / "b.bt"
    a.write_text("selector {" + " MoveToGarbage" * 4000 + " }")
    b.write_text("selector {" + " MoveToGarbage" * 4000 + " PatrolWaypoint }")
    result = islandgp("diff", a, b)
    assert result.code == 1
    assert result.out.splitlines()[:2] == [
        "+   PatrolWaypoint  # 1",
        "0 deleted, 1 inserted, 0 changed",
    ]


def test_unlike_trees_of_4000_nodes() -> None:
    """Two large trees with little in common are compared in seconds."""
    rng = Random(1)
    a, b = (selector(*(leaf(rng.choice("ABCDEFG")) for _ in range(4000))) for _ in range(2))
    start = process_time()
    assert len(compare(a, b)) > 4000
    assert process_time() - start < 10


def test_equal_trees_of_two_domains_are_not_the_same(tmp_path: Path, islandgp: Cli) -> None:
    """Each domain gives its own meanings to the names; a missing name is no other domain."""
    for name in ("", "domain island\n", "domain moon\n"):
        (tmp_path / (name.split()[-1] if name else "none")).write_text(f"{name}PatrolWaypoint\n")
    (tmp_path / "other").write_text("domain moon selector { PatrolWaypoint }")
    result = islandgp("diff", tmp_path / "island", tmp_path / "moon")
    assert (result.code, result.err) == (1, "")
    assert result.out == "They are for two domains: island and moon.\nThe same nodes.\n"
    assert islandgp("diff", tmp_path / "island", tmp_path / "none").out == "The same tree.\n"
    result = islandgp("diff", tmp_path / "island", tmp_path / "other")
    assert result.code == 1
    assert "two domains" in result.out
