"""What changed between two trees: the shortest edit by Zhang and Shasha (1989).

An edit deletes a node (its children move up), inserts one, or changes one in
place. So a guard put around a branch shows as one inserted node, where a
comparison of texts would show the whole branch.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Final, NamedTuple

from islandgp.bt.node import Node, size

MOST_NODES: Final = 300  # of each tree; the work grows with the square and more
_GONE: Final = 2  # cost of deleting or inserting a node
_ARGUMENTS: Final = 1  # of changing its arguments
_KIND: Final = 3  # of changing an action, or one inner kind into another
_NEVER: Final = 5  # dearer than deleting one and inserting the other


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


def compare(old: Node, new: Node) -> list[DiffLine]:
    """The nodes of both trees with what happened to them; a node is told without its children.

    Raises:
        ValueError: a tree has more than MOST_NODES nodes.
    """
    if max(size(old), size(new)) > MOST_NODES:
        raise ValueError(f"Expected trees of at most {MOST_NODES} nodes.")
    a, b = _Ordered(old), _Ordered(new)
    return list(_lines(a, b, dict(_Matching(a, b).pairs())))


def distance(old: Node, new: Node) -> int:
    """The cost of the shortest edit, 0 for equal trees."""
    return _Matching(_Ordered(old), _Ordered(new)).cost


class _Ordered:
    """A tree's nodes in postorder, from 1, with what the algorithm asks for."""

    def __init__(self, tree: Node) -> None:
        self.nodes: list[Node] = [tree]  # place 0 is not used
        self.first_leaf = [0]  # the leftmost leaf below each node
        self.place = [0]  # of each node in document order, from 0
        self.levels = [0]
        self._visited = 0
        self._visit(tree, 0)
        last_with = {leaf: i for i, leaf in enumerate(self.first_leaf) if i}
        self.keys = sorted(last_with.values())

    def _visit(self, node: Node, level: int) -> int:
        place, self._visited = self._visited, self._visited + 1
        leaves = [self._visit(child, level + 1) for child in node.children]
        self.nodes.append(node)
        self.first_leaf.append(leaves[0] if leaves else len(self.nodes) - 1)
        self.place.append(place)
        self.levels.append(level)
        return self.first_leaf[-1]


class _Matching:
    """Costs of all pairs of subtrees, and the pairs of nodes that the shortest edit keeps."""

    def __init__(self, a: _Ordered, b: _Ordered) -> None:
        self.a, self.b = a, b
        self.costs = [[0] * len(b.nodes) for _ in a.nodes]
        for i in a.keys:
            for j in b.keys:
                self._forest(i, j)
        self.cost = self.costs[-1][-1]

    def _forest(self, i: int, j: int) -> list[list[int]]:
        """Costs of turning the first nodes below i into the first below j, for each number."""
        a, b, costs = self.a, self.b, self.costs
        ai, bj = a.first_leaf[i], b.first_leaf[j]
        rows, columns = i - ai + 2, j - bj + 2
        table = [[_GONE * y for y in range(columns)]]
        for x in range(1, rows):
            above = table[-1]
            row = [_GONE * x]
            table.append(row)
            m = ai + x - 1
            whole, skip = a.first_leaf[m] == ai, a.first_leaf[m] - ai
            for y in range(1, columns):
                n = bj + y - 1
                best = min(above[y], row[y - 1]) + _GONE
                if whole and b.first_leaf[n] == bj:
                    best = min(best, above[y - 1] + _price(a.nodes[m], b.nodes[n]))
                    costs[m][n] = best
                else:
                    best = min(best, table[skip][b.first_leaf[n] - bj] + costs[m][n])
                row.append(best)
        return table

    def pairs(self) -> Iterator[tuple[int, int]]:
        """(node of a, node of b) by postorder number."""
        waiting = [(len(self.a.nodes) - 1, len(self.b.nodes) - 1)]
        while waiting:
            i, j = waiting.pop()
            table = self._forest(i, j)
            ai, bj = self.a.first_leaf[i], self.b.first_leaf[j]
            x, y = i - ai + 1, j - bj + 1
            while x and y:
                m, n = ai + x - 1, bj + y - 1
                if table[x][y] == table[x - 1][y] + _GONE:
                    x -= 1
                elif table[x][y] == table[x][y - 1] + _GONE:
                    y -= 1
                elif self.a.first_leaf[m] == ai and self.b.first_leaf[n] == bj:
                    yield m, n
                    x, y = x - 1, y - 1
                else:
                    waiting.append((m, n))
                    x, y = self.a.first_leaf[m] - ai, self.b.first_leaf[n] - bj


def _price(old: Node, new: Node) -> int:
    if old.kind == new.kind:
        if old.args == new.args:
            return 0
        return _KIND if old.kind == "action" else _ARGUMENTS
    return _NEVER if "action" in (old.kind, new.kind) else _KIND


def _lines(a: _Ordered, b: _Ordered, partners: dict[int, int]) -> Iterator[DiffLine]:
    by_place_a = sorted(range(1, len(a.nodes)), key=a.place.__getitem__)
    by_place_b = sorted(range(1, len(b.nodes)), key=b.place.__getitem__)
    back = {j: i for i, j in partners.items()}
    deleted = iter(by_place_a)
    for j in by_place_b:
        new = b.nodes[j]
        if j not in back:
            yield DiffLine(Mark.INSERTED, b.levels[j], None, new)
            continue
        for i in deleted:
            if i == back[j]:
                break
            yield DiffLine(Mark.DELETED, a.levels[i], a.nodes[i], None)
        old = a.nodes[back[j]]
        same = (old.kind, old.args) == (new.kind, new.args)
        yield DiffLine(Mark.SAME if same else Mark.CHANGED, b.levels[j], old, new)
    for i in deleted:
        yield DiffLine(Mark.DELETED, a.levels[i], a.nodes[i], None)
