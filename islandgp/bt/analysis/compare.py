"""The differences between two trees, node by node.

Nodes are compared in document order. So a guard around a branch is one inserted node, while a
comparison of texts would show the whole branch as changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from enum import StrEnum
from typing import NamedTuple

from islandgp.bt.core.node import Node, levels, walk


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


def compare(old: Node, new: Node) -> list[DiffLine]:
    """The nodes of both trees, one line each, marked as deleted, inserted, changed or equal.

    A node that is equal but below another node than before is marked as changed.
    """
    nodes = list(walk(old)), list(walk(new))
    depths = levels(old), levels(new)
    above = [(0, -1)], [(0, -1)]  # of each tree: (level, line) of the nodes above in both trees
    lines: list[DiffLine] = []
    for i, j in _rows(*nodes):
        level, parents = 0, []
        for stack, depth, at in zip(above, depths, (i, j), strict=True):
            if at is not None:
                level = depth[at]
                while stack[-1][0] >= level:
                    stack.pop()
                parents.append(stack[-1][1])
                if None not in (i, j):
                    stack.append((level, len(lines)))
        if i is None:
            mark = Mark.INSERTED
        elif j is None:
            mark = Mark.DELETED
        else:
            same = nodes[0][i][:2] == nodes[1][j][:2] and parents[0] == parents[1]
            mark = Mark.SAME if same else Mark.CHANGED
        before, after = (None if at is None else n[at] for n, at in zip(nodes, (i, j), strict=True))
        lines.append(DiffLine(mark, level - 1, before, after, i, j))
    return lines


def _rows(old: Sequence[Node], new: Sequence[Node]) -> Iterator[tuple[int | None, int | None]]:
    """The places of nodes that are equal or can become each other, and of deleted and new ones."""
    before, after = ([node[:2] for node in nodes] for nodes in (old, new))
    for tag, i, i_end, j, j_end in SequenceMatcher(None, before, after).get_opcodes():
        a, b = range(i, i_end), range(j, j_end)
        leaves = [old[i].action != "" for i in a], [new[j].action != "" for j in b]
        if tag == "equal" or leaves[0] == leaves[1]:
            yield from zip(a, b, strict=True)
        else:
            yield from ((i, None) for i in a)
            yield from ((None, j) for j in b)
