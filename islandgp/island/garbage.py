"""Garbage on the ground, found by place: the cost of a look does not grow with the island."""

from __future__ import annotations

from collections.abc import Iterable
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
        self.cells: list[list[Item]] = [[] for _ in range(self.columns**2)]
        self.count = 0
        self.due = 0  # step from which a look can give something else
        self._near: list[Item] = []  # items of the nine cells around `_at`
        self._at = -1
        for z in start:
            self.drop(z.real, z.imag)

    def drop(self, x: float, y: float) -> bool:
        """A new item, unless the ground is full."""
        if self.count >= self.most:
            return False
        self.cells[self._cell(x, y)].append(Item(x, y))
        self.count += 1
        self._at = -1
        return True

    def take(self, item: Item) -> None:
        """The item is gone."""
        self.cells[self._cell(item.x, item.y)].remove(item)
        item.there = False
        self.count -= 1
        self._at = -1
        self.due = 0

    def items(self) -> list[Item]:
        """All items, cell by cell."""
        return [item for cell in self.cells for item in cell]

    def around(self, x: float, y: float) -> list[Item]:
        """The items of the nine cells around a point: all that are within `cell` metres."""
        at = self._cell(x, y)
        if at != self._at:
            self._at, n, cells = at, self.columns, self.cells
            self._near = [
                item
                for row in (at - n, at, at + n)
                for cell in cells[row - 1 : row + 2]
                if cell
                for item in cell
            ]
        return self._near

    def nearest(self, x: float, y: float) -> tuple[Item | None, float]:
        """The nearest item around and its distance in metres; (None, inf) if there is none."""
        best, least = None, inf
        for item in self.around(x, y):
            dx, dy = item.x - x, item.y - y
            square = dx * dx + dy * dy
            if square < least:
                best, least = item, square
        return best, least**0.5

    def to_border(self, x: float, y: float, ux: float, uy: float) -> float:
        """Metres to the border of the cell that holds (x, y), along a unit direction."""
        east, north = x % self.cell, y % self.cell
        along_x = (self.cell - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
        along_y = (self.cell - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
        return min(along_x, along_y)

    def _cell(self, x: float, y: float) -> int:
        return (int(y // self.cell) + 1) * self.columns + int(x // self.cell) + 1
