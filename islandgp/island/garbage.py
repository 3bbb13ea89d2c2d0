"""Garbage on the ground, as arrays that are looked at all at once."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

AWAY = complex(1e9, 0)  # where a place that holds no item lies


class Ground:
    """Places for items. An index is an item's name while it lies there."""

    def __init__(self, start: Iterable[complex], most: int) -> None:
        items = list(start)
        self.most = most
        self.count = len(items)
        self.where = np.full(max(1, most), AWAY, dtype=complex)  # positions x + iy in metres
        self.where[: len(items)] = items
        self.known = np.zeros(len(self.where))  # inf: seen before, or no item there; else 0
        self.known[len(items) :] = np.inf
        self.free = list(range(most - 1, len(items) - 1, -1))
        self.due = 0  # step at which it must be looked at again

    def drop(self, at: complex) -> bool:
        """A new item, unless the ground is full."""
        if not self.free:
            return False
        i = self.free.pop()
        self.where[i] = at
        self.known[i] = 0.0
        self.count += 1
        return True

    def take(self, i: int) -> None:
        """Item `i` is gone."""
        self.where[i] = AWAY
        self.known[i] = np.inf
        self.free.append(i)
        self.count -= 1

    def distances(self, x: float, y: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Distance of every place from (x, y), in metres."""
        return np.abs(self.where - complex(x, y))

    def nearest(self, x: float, y: float) -> tuple[int, float]:
        """The nearest item and its distance in metres (a huge one where there is none)."""
        gaps = self.distances(x, y)
        i = int(gaps.argmin())
        return i, float(gaps[i])
