"""The differences between two trees, node by node.

Nodes are compared in document order, together with the places where they end. So a guard around a
branch is one inserted node, while a comparison of texts would show the whole branch as changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher
from enum import StrEnum
from itertools import count
from typing import NamedTuple, TypeAlias

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
    end: bool  # True: the end of a node that is in both trees but ends at different places
    old_place: int | None = None  # of the node in document order
    new_place: int | None = None


class _Edge(NamedTuple):
    """The beginning of a node, or the end of one with children."""

    node: Node
    level: int
    begin: int  # the place of its beginning among the edges
    place: int  # of the node in document order
    end: bool


_Row: TypeAlias = tuple[Mark, _Edge | None, _Edge | None]  # mark, old edge, new edge


def compare(old: Node, new: Node) -> list[DiffLine]:
    """The nodes of both trees, one line each, marked as deleted, inserted, changed or equal."""
    lines: list[DiffLine] = []
    marked: tuple[set[int], set[int]] = set(), set()  # beginnings of nodes, in both trees
    for mark, a, b in _rows(_edges(old), _edges(new)):
        sides = [(edge, started) for edge, started in zip((a, b), marked, strict=True) if edge]
        edge = sides[-1][0]
        if edge.end and (mark is Mark.SAME or any(e.begin in started for e, started in sides)):
            continue
        if mark is not Mark.SAME and not edge.end:
            for each, started in sides:
                started.add(each.begin)
        nodes, places = (a and a.node, b and b.node), (a and a.place, b and b.place)
        lines.append(DiffLine(mark, edge.level, *nodes, edge.end, *places))
    return lines


def _edges(tree: Node) -> list[_Edge]:
    """The edges of a tree in document order."""
    edges: list[_Edge] = []

    places = count()

    def visit(node: Node, level: int) -> None:
        begin, place = len(edges), next(places)
        edges.append(_Edge(node, level, begin, place, False))
        for child in node.children:
            visit(child, level + 1)
        if node.children:
            edges.append(_Edge(node, level, begin, place, True))

    visit(tree, 0)
    return edges


def _rows(old: Sequence[_Edge], new: Sequence[_Edge]) -> Iterator[_Row]:
    """The edges of both trees in order, with equal ones paired."""
    before, after = ([(e.end, e.node.kind, e.node.args) for e in edges] for edges in (old, new))
    for tag, i, i_end, j, j_end in SequenceMatcher(None, before, after).get_opcodes():
        a, b = old[i:i_end], new[j:j_end]
        sorts = [[(edge.end, edge.node.action != "") for edge in part] for part in (a, b)]
        if sorts[0] == sorts[1]:  # each is equal, or can become the other in place
            mark = Mark.SAME if tag == "equal" else Mark.CHANGED
            yield from ((mark, *pair) for pair in zip(a, b, strict=True))
        else:
            yield from ((Mark.DELETED, edge, None) for edge in a)
            yield from ((Mark.INSERTED, None, edge) for edge in b)
