"""What changed between two trees, node by node.

Nodes are compared in document order, with the places where they end. So a guard put around a
branch shows as one inserted node, where a comparison of texts would show the whole branch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from enum import StrEnum
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.core.node import Node

EXACT: Final = 1_000  # edges of a tree; in a larger one those that are frequent guide nothing


class Mark(StrEnum):
    """What happened to a node."""

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
    end: bool  # of a node that is the same, in a place where the other tree's does not end


class _Edge(NamedTuple):
    """Where a node begins, or one with children ends."""

    node: Node
    level: int
    begin: int  # the place of its beginning among the edges
    end: bool


_Row: TypeAlias = tuple[Mark, _Edge | None, _Edge | None]  # what became of an edge, in both trees


def compare(old: Node, new: Node) -> list[DiffLine]:
    """The nodes of both trees with what happened to them; a node is told without its children."""
    found: list[DiffLine] = []
    marked: tuple[set[int], set[int]] = set(), set()  # beginnings of nodes, in both trees
    for mark, a, b in _rows(_edges(old), _edges(new)):
        sides = [(edge, begun) for edge, begun in zip((a, b), marked, strict=True) if edge]
        edge = sides[-1][0]
        if edge.end and (mark is Mark.SAME or any(e.begin in begun for e, begun in sides)):
            continue
        if mark is not Mark.SAME and not edge.end:
            for each, begun in sides:
                begun.add(each.begin)
        found.append(DiffLine(mark, edge.level, a and a.node, b and b.node, edge.end))
    return found


def _edges(tree: Node) -> list[_Edge]:
    """The edges of a tree in document order."""
    found: list[_Edge] = []

    def visit(node: Node, level: int) -> None:
        begin = len(found)
        found.append(_Edge(node, level, begin, False))
        for child in node.children:
            visit(child, level + 1)
        if node.children:
            found.append(_Edge(node, level, begin, True))

    visit(tree, 0)
    return found


def _rows(old: Sequence[_Edge], new: Sequence[_Edge]) -> Iterator[_Row]:
    """The edges of both trees in their order, the same ones together."""
    before, after = ([(e.end, e.node.kind, e.node.args) for e in edges] for edges in (old, new))
    matcher = SequenceMatcher(None, before, after, autojunk=max(len(old), len(new)) > EXACT)
    for what, i, behind_i, j, behind_j in matcher.get_opcodes():
        a, b = old[i:behind_i], new[j:behind_j]
        sorts = [[(edge.end, edge.node.action != "") for edge in part] for part in (a, b)]
        if sorts[0] == sorts[1]:  # each can become the other in place
            mark = Mark.SAME if what == "equal" else Mark.CHANGED
            yield from ((mark, *pair) for pair in zip(a, b, strict=True))
        else:
            yield from ((Mark.DELETED, edge, None) for edge in a)
            yield from ((Mark.INSERTED, None, edge) for edge in b)
