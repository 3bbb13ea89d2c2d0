"""The robot's map of a level, and shortest paths in it.

A set of places is an integer with a bit per place, so a search step in all directions is four
shifts. The field of view is that of MiniGrid (`Grid.process_vis`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Final

VIEW: Final = 7  # places across and ahead, as MiniGrid's `agent_view_size`
SIDE: Final = VIEW // 2
ROW: Final = (1 << VIEW) - 1
RIGHT, DOWN, LEFT, UP = range(4)  # MiniGrid's directions


class Memory:
    """The robot's map of a level.

    Attributes:
        stride: places from one row to the next, a margin included.
        inside: the places of the level.
        seen: those of them that it has seen.
        free: places without wall or thing, as they are; what is known is `free & seen`.
    """

    def __init__(self, width: int, height: int) -> None:
        self.stride = width + 2 * VIEW
        self._tall = height + 2 * VIEW
        self.inside = sum(self.at(x, y) for x in range(width) for y in range(height))
        self.seen = self.free = 0
        self._seen_down = 0  # `seen`, column by column
        self._opaque = (1 << self.stride * self._tall) - 1  # row by row
        self._opaque_down = self._opaque  # column by column

    def at(self, x: int, y: int) -> int:
        """The bit of a place."""
        return 1 << (y + VIEW) * self.stride + x + VIEW

    def fill(self, free: int, transparent: int) -> None:
        """Sets the cells that can be walked on and those that can be seen through, as bits."""
        self.free = free
        everything = (1 << self.stride * self._tall) - 1
        self._opaque = everything & ~transparent
        self._opaque_down = everything & ~self._down(transparent)

    def _down(self, places: int) -> int:
        """Places row by row as places column by column."""
        shifted = 0
        for bit in bits(places):
            row, column = divmod(bit.bit_length() - 1, self.stride)
            shifted |= 1 << column * self._tall + row
        return shifted

    def look(self, x: int, y: int, direction: int) -> int:
        """Updates the map with the view from a place; returns the number of new places."""
        upright = direction in (UP, DOWN)
        stride, opaque = (self.stride, self._opaque) if upright else (self._tall, self._opaque_down)
        ahead, across = (y, x) if upright else (x, y)
        shift = (ahead + VIEW) * stride + across + VIEW - SIDE
        step = stride if direction in (RIGHT, DOWN) else -stride
        row, cells = 1 << SIDE, 0
        for _ in range(VIEW):
            row, further = spread(row, opaque >> shift & ROW)
            cells |= row << shift
            if not further:
                break
            row = further
            shift += step
        if upright:
            new = cells & self.inside & ~self.seen
            if new:
                self.seen |= new
                self._seen_down |= self._down(new)
            return new.bit_count()
        new = cells & ~self._seen_down
        if not new:
            return 0
        self._seen_down |= new
        before = self.seen
        for bit in bits(new):
            column, row = divmod(bit.bit_length() - 1, self._tall)
            self.seen |= 1 << row * self.stride + column
        self.seen &= self.inside
        return (self.seen & ~before).bit_count()

    def around(self, places: int) -> int:
        """The four neighbours of each place."""
        return places << 1 | places >> 1 | places << self.stride | places >> self.stride

    @property
    def frontier(self) -> int:
        """Known free places next to an unseen place."""
        return self.free & self.seen & self.around(self.inside & ~self.seen)

    def way(self, start: int, ends: int) -> list[int] | None:
        """The places of a shortest known way to one of `ends`, the first step first.

        None if there is no way; [] if it is at one already.
        """
        if start & ends:
            return []
        unvisited, layers = self.free & self.seen & ~start, [start]
        while True:
            layer = self.around(layers[-1]) & unvisited
            if not layer:
                return None
            if neighbours := layer & ends:
                break
            layers.append(layer)
            unvisited &= ~layer
        way = [neighbours & -neighbours]
        for layer in layers[:0:-1]:
            neighbours = self.around(way[-1]) & layer
            way.append(neighbours & -neighbours)
        return way[::-1]


def bits(places: int) -> Iterator[int]:
    """The single places of a set."""
    while places:
        bit = places & -places
        yield bit
        places ^= bit


@cache
def spread(row: int, opaque: int) -> tuple[int, int]:
    """The visible cells of a row of the view and of the next row, from those visible so far."""
    clear = row & ~opaque
    while True:
        reached = (clear << 1 | clear >> 1) & ROW & ~opaque & ~clear
        if not reached:
            break
        clear |= reached
    visible = (row | clear | clear << 1 | clear >> 1) & ROW
    return visible, (clear | clear << 1 | clear >> 1) & ROW
