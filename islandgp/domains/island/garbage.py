"""Garbage on the ground, in a grid, so the cost of a look does not grow with the island."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, inf

from islandgp.domains.island.schedule import Schedule


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Positions of all items of an episode, by index."""

    x: tuple[float, ...]  # m
    y: tuple[float, ...]  # m
    near: tuple[tuple[int, ...], ...]  # of each cell: the items in it and in the eight around it
    cell: float  # m, the width of a cell
    columns: int  # cells in a row, including empty ones at the margin

    def around(self, x: float, y: float) -> tuple[int, ...]:
        """The items of the nine cells around a point: all that are within `cell` metres."""
        return self.near[(int(y // self.cell) + 1) * self.columns + int(x // self.cell) + 1]


@lru_cache(maxsize=32)
def _places(schedule: Schedule, side: float, cell: float) -> Places:
    """The items of a day on an island of `side` metres, in cells of `cell` metres."""
    items = (*schedule.garbage, *(complex(x, y) for _, x, y in schedule.spawns[:-1]))
    columns = ceil(side / cell) + 2
    near: list[list[int]] = [[] for _ in range(columns**2)]
    for number, z in enumerate(items):
        lowest = int(z.imag // cell) * columns + int(z.real // cell)  # of the nine around it
        for row in range(3):
            for i in range(lowest + row * columns, lowest + row * columns + 3):
                near[i].append(number)
    return Places(
        tuple(z.real for z in items),
        tuple(z.imag for z in items),
        tuple(map(tuple, near)),
        cell,
        columns,
    )


class Ground:
    """The items of an episode: those on the ground, and those that the robot has discovered."""

    def __init__(self, schedule: Schedule, *, most: int, side: float, cell: float) -> None:
        """At most `most` items are on the ground of an island of `side` metres."""
        first, spawned = len(schedule.garbage), len(schedule.spawns) - 1
        self.places = _places(schedule, side, cell)
        self.first = first  # items at the start, which have the lowest numbers
        self.present = bytearray(b"\1" * first + b"\0" * spawned)
        self.discovered = bytearray(first + spawned)
        self.room = most - first  # number of items that can still appear
        self.next_look = 0  # the step from which a look can have another result
        self._items: tuple[complex, ...] | None = None  # `items`; None: changed since the last call

    @property
    def count(self) -> int:
        """Number of items on the ground."""
        return sum(self.present)

    def drop(self, item: int) -> None:
        """Add an item."""
        self.present[item] = True
        self._items = None
        self.room -= 1

    def take(self, item: int) -> None:
        """Remove an item."""
        self.present[item] = False
        self._items = None
        self.room += 1
        self.next_look = 0

    def items(self) -> tuple[complex, ...]:
        """Positions of all items, x + iy in metres, in the order of their appearance."""
        if self._items is None:
            places = zip(self.places.x, self.places.y, self.present, strict=True)
            self._items = tuple(complex(x, y) for x, y, is_present in places if is_present)
        return self._items

    def nearest(self, x: float, y: float) -> tuple[int, float, float]:
        """The nearest item around, and the metres to it and to the next (-1, inf: no item)."""
        best, nearest, second = -1, inf, inf
        xs, ys, present = self.places.x, self.places.y, self.present
        for item in self.places.around(x, y):
            if not present[item]:
                continue
            dx, dy = xs[item] - x, ys[item] - y
            square = dx * dx + dy * dy
            if square < nearest:
                best, nearest, second = item, square, nearest
            elif square < second:
                second = square
        return best, nearest**0.5, second**0.5
