"""Garbage on the ground, found by place: the cost of a look does not grow with the island."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from math import ceil, inf


class Item:
    """A piece of garbage."""

    __slots__ = ("seen", "there", "x", "y")

    def __init__(self, x: float, y: float) -> None:
        self.x = x  # m
        self.y = y  # m
        self.seen = False  # by the robot
        self.there = True  # on the ground


class Ground:
    """The items on the ground, in square cells that are wider than the robot can see."""

    def __init__(self, start: Iterable[complex], *, most: int, side: float, cell: float) -> None:
        """At most `most` items on an island of `side` metres; `cell` metres a cell."""
        self.most = most
        self.cell = cell
        self.columns = ceil(side / cell) + 2  # a ring of empty cells keeps neighbours simple
        # What lies in a cell and in the eight around it, in the order in which it came.
        self._near: list[list[Item]] = [[] for _ in range(self.columns**2)]
        self._items: dict[Item, None] = {}
        self.due = 0  # step from which a look can give something else
        for z in start:
            self.drop(z.real, z.imag)

    @property
    def count(self) -> int:
        """How many items there are."""
        return len(self._items)

    def drop(self, x: float, y: float) -> bool:
        """A new item, unless the ground is full."""
        if len(self._items) >= self.most:
            return False
        item = Item(x, y)
        self._items[item] = None
        for near in self._seen_from(x, y):
            near.append(item)
        return True

    def take(self, item: Item) -> None:
        """The item is gone."""
        del self._items[item]
        for near in self._seen_from(item.x, item.y):
            near.remove(item)
        item.there = False
        self.due = 0

    def items(self) -> list[Item]:
        """All items, in the order in which they came."""
        return list(self._items)

    def around(self, x: float, y: float) -> list[Item]:
        """The items of the nine cells around a point: all that are within `cell` metres."""
        return self._near[(int(y // self.cell) + 1) * self.columns + int(x // self.cell) + 1]

    def nearest(self, x: float, y: float) -> tuple[Item | None, float]:
        """The nearest item around and its distance in metres; (None, inf) if there is none."""
        best, least = None, inf
        for item in self.around(x, y):
            dx, dy = item.x - x, item.y - y
            square = dx * dx + dy * dy
            if square < least:
                best, least = item, square
        return best, least**0.5

    def along(self, x: float, y: float, ux: float, uy: float) -> tuple[list[Item], float]:
        """The items around a point, and metres to another cell along a unit direction."""
        (column, east), (row, north) = divmod(x, self.cell), divmod(y, self.cell)
        items = self._near[(int(row) + 1) * self.columns + int(column) + 1]
        along_x = (self.cell - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
        along_y = (self.cell - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
        return items, along_x if along_x < along_y else along_y

    def _seen_from(self, x: float, y: float) -> Iterable[list[Item]]:
        """The lists of the nine cells that a point is near to."""
        n, near = self.columns, self._near
        at = int(y // self.cell) * n + int(x // self.cell)  # the lowest of the nine
        return chain(
            near[at : at + 3], near[at + n : at + n + 3], near[at + 2 * n : at + 2 * n + 3]
        )
