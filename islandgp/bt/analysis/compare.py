"""The differences between two trees, node by node.

Nodes are compared in document order. So a guard around a branch is one inserted node, while a
comparison of texts would show the whole branch as changed.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from difflib import SequenceMatcher
from enum import StrEnum
from typing import NamedTuple

from islandgp.bt.core.node import Node


class Mark(StrEnum):
    """Mark of a node in a comparison."""

    SAME = " "
    DELETED = "-"
    INSERTED = "+"
    CHANGED = "~"


class DiffLine(NamedTuple):
    """A node of either tree, in document order of both."""

    mark: Mark
    level: int  # in its own tree, from 0
    old: Node | None  # None: inserted
    new: Node | None  # None: deleted
    old_place: int | None  # of the node in document order
    new_place: int | None


class _Listed(NamedTuple):
    node: Node
    level: int
    parent: int  # place in document order; -1: none


def compare(old: Node, new: Node) -> list[DiffLine]:
    """The nodes of both trees, one line each, marked as deleted, inserted, changed or equal.

    A node that is equal but below another node than before is marked as changed.
    """
    a, b = _listed(old), _listed(new)
    rows = [*_rows(a, b)]
    pairs = {-1: -1} | {i: j for i, j in rows if i is not None and j is not None}
    back = {j: i for i, j in pairs.items()}
    lines: list[DiffLine] = []
    for i, j in rows:
        if j is None and i is not None:
            lines.append(DiffLine(Mark.DELETED, a[i].level, a[i].node, None, i, None))
        elif i is None and j is not None:
            lines.append(DiffLine(Mark.INSERTED, b[j].level, None, b[j].node, None, j))
        elif i is not None and j is not None:
            same = a[i].node[:2] == b[j].node[:2]
            same = same and pairs[_above(a, i, pairs)] == _above(b, j, back)
            mark = Mark.SAME if same else Mark.CHANGED
            lines.append(DiffLine(mark, b[j].level, a[i].node, b[j].node, i, j))
    return lines


def _listed(tree: Node) -> list[_Listed]:
    """The nodes of a tree in document order."""
    nodes: list[_Listed] = []

    def visit(node: Node, level: int, parent: int) -> None:
        place = len(nodes)
        nodes.append(_Listed(node, level, parent))
        for child in node.children:
            visit(child, level + 1, place)

    visit(tree, 0, -1)
    return nodes


def _rows(
    old: Sequence[_Listed], new: Sequence[_Listed]
) -> Iterator[tuple[int | None, int | None]]:
    """The places of nodes that are equal or can become each other, and of deleted and new ones."""
    before, after = ([each.node[:2] for each in nodes] for nodes in (old, new))
    for tag, i, i_end, j, j_end in SequenceMatcher(None, before, after).get_opcodes():
        a, b = range(i, i_end), range(j, j_end)
        leaves = [old[i].node.action != "" for i in a], [new[j].node.action != "" for j in b]
        if tag == "equal" or leaves[0] == leaves[1]:
            yield from zip(a, b, strict=True)
        else:
            yield from ((i, None) for i in a)
            yield from ((None, j) for j in b)


def _above(nodes: Sequence[_Listed], place: int, paired: Container[int]) -> int:
    """The place of the nearest node above that is in both trees; -1: none."""
    place = nodes[place].parent
    while place not in paired:
        place = nodes[place].parent
    return place
