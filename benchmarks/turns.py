"""Timing in turns: A B, B A, A B, ... so that both sides meet the same machine."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from statistics import median

Clock = Callable[[], float]  # seconds


def turns(
    sides: Sequence[Callable[[], object]], rounds: int, *, clock: Clock
) -> list[tuple[float, ...]]:
    """Seconds of each side, a row for each of `rounds` >= 1; every other row runs backwards.

    With `time.process_time` as the clock, time in which other programs had the
    core does not count; work that other processes do needs `time.perf_counter`.
    """
    rows = []
    for turn in range(rounds):
        row = [0.0] * len(sides)
        places = range(len(sides))
        for place in places if turn % 2 == 0 else reversed(places):
            gc.collect()
            began = clock()
            sides[place]()
            row[place] = clock() - began
        rows.append(tuple(row))
    return rows


def medians(rows: Sequence[Sequence[float]]) -> list[float]:
    """The median of each side."""
    return [median(column) for column in zip(*rows, strict=True)]


def ratio(rows: Sequence[Sequence[float]], over: int, under: int) -> float:
    """The median of the rows' own ratios: what was slow for both sides cancels out."""
    return median(row[over] / row[under] for row in rows)
