"""Garbage on the ground, found by place: the cost of a look does not grow with the island."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
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

    def __init__(self, start: tuple[complex, ...], *, most: int, side: float, cell: float) -> None:
        """At most `most` items on an island of `side` metres; `cell` metres a cell."""
        self.cell = cell
        self.columns = _columns(side, cell)
        self._items = [Item(z.real, z.imag) for z in start]  # all that ever came, in their order
        # The numbers of what came into a cell and into the eight around it, and, after the first
        # look there, those of them that are left.
        self._came = list(_near(start, side, cell))
        self._near: list[list[Item] | None] = [None] * len(self._came)
        self.room = most - len(start)  # how many items more may come
        self.due = 0  # step from which a look can give something else

    @property
    def count(self) -> int:
        """How many items there are."""
        return sum(item.there for item in self._items)

    def drop(self, x: float, y: float) -> None:
        """A new item."""
        item, number = Item(x, y), len(self._items)
        self._items.append(item)
        self.room -= 1
        for i in _seen_from(x, y, self.cell, self.columns):
            self._came[i] += (number,)
            near = self._near[i]
            if near is not None:
                near.append(item)

    def take(self, item: Item) -> None:
        """The item is gone."""
        item.there = False
        self.room += 1
        for i in _seen_from(item.x, item.y, self.cell, self.columns):
            near = self._near[i]
            if near is not None:
                near.remove(item)
        self.due = 0

    def items(self) -> list[Item]:
        """All items, in the order in which they came."""
        return [item for item in self._items if item.there]

    def around(self, x: float, y: float) -> list[Item]:
        """The items of the nine cells around a point: all that are within `cell` metres."""
        return self._at((int(y // self.cell) + 1) * self.columns + int(x // self.cell) + 1)

    def nearest(self, x: float, y: float) -> tuple[Item | None, float, float]:
        """The nearest item around, and the metres to it and to the next (None, inf: no item)."""
        best, least, second = None, inf, inf
        for item in self.around(x, y):
            dx, dy = item.x - x, item.y - y
            square = dx * dx + dy * dy
            if square < least:
                best, least, second = item, square, least
            elif square < second:
                second = square
        return best, least**0.5, second**0.5

    def along(self, x: float, y: float, ux: float, uy: float) -> tuple[list[Item], float]:
        """The items around a point, and metres to another cell along a unit direction."""
        (column, east), (row, north) = divmod(x, self.cell), divmod(y, self.cell)
        items = self._at((int(row) + 1) * self.columns + int(column) + 1)
        along_x = (self.cell - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
        along_y = (self.cell - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
        return items, along_x if along_x < along_y else along_y

    def _at(self, i: int) -> list[Item]:
        near = self._near[i]
        if near is None:
            items = self._items
            near = [items[n] for n in self._came[i] if items[n].there]
            self._near[i] = near
        return near


def _columns(side: float, cell: float) -> int:
    """Cells in a row, with a ring of empty ones, which keeps neighbours simple."""
    return ceil(side / cell) + 2


def _seen_from(x: float, y: float, cell: float, columns: int) -> Iterable[int]:
    """The indices of the nine cells that a point is near to."""
    at = int(y // cell) * columns + int(x // cell)  # the lowest of the nine
    return (
        at,
        at + 1,
        at + 2,
        at + columns,
        at + columns + 1,
        at + columns + 2,
        at + 2 * columns,
        at + 2 * columns + 1,
        at + 2 * columns + 2,
    )


@lru_cache(maxsize=4)
def _near(start: tuple[complex, ...], side: float, cell: float) -> tuple[tuple[int, ...], ...]:
    """For each cell, the numbers of the items at the start that are near it: once for a world."""
    columns = _columns(side, cell)
    near: list[list[int]] = [[] for _ in range(columns**2)]
    for number, z in enumerate(start):
        for i in _seen_from(z.real, z.imag, cell, columns):
            near[i].append(number)
    return tuple(map(tuple, near))
