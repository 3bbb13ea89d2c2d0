"""Progress of a run: a line for each generation."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from time import monotonic
from typing import Literal

from islandgp.gp.record import Step
from islandgp.text import in_points


def duration(seconds: float) -> str:
    """A duration as text: `8 s`, `3 min 05 s`, `2 h 07 min`, `3 d 04 h`."""
    total = max(0, round(seconds))
    if total < 60:
        return f"{total} s"
    for unit, small, size, limit in (("min", "s", 60, 60), ("h", "min", 3600, 24)):
        if total < size * limit:
            return f"{total // size} {unit} {total % size * 60 // size:02d} {small}"
    return f"{total // 86400} d {total % 86400 // 3600:02d} h"


class Progress:
    """Shows the progress of a run on the error stream, unless `mode` is off.

    Each milestone has a column with the number of individuals in that tier. `mutation` is the
    mutation rate of the next generation, with a "!" if a crisis enforces it; only searches that use
    the rate have it. `time left` is estimated.
    """

    def __init__(
        self,
        mode: Literal["plain", "off"],
        generations: int,
        title: str,
        milestones: Sequence[str],
        *,
        rate: bool = True,
        done: int = 0,
    ) -> None:
        """Prints the title and the head of the table.

        Args:
            mode: plain: a line for each generation.
            generations: number of all generations, >= 1.
            title: first line.
            milestones: tiers with a column.
            rate: the search uses the mutation rate, which then has a column.
            done: generations before a resumed run continues.
        """
        self.mode, self.generations, self.milestones = mode, generations, milestones
        self.rate, self.done, self._before = rate, done, done
        self._began = monotonic()
        head = ["generation", "best", "mean", "diversity", "working", *milestones]
        head += [*["mutation"] * rate, "time left"]
        widths = (10, 9, 9, 9, 7, *(max(4, len(name)) for name in milestones), *[8] * rate, 9)
        self._widths = widths
        self._print(title + (f" (from generation {done})" if done else ""))
        self._print_cells(head)

    def show(self, step: Step) -> None:
        """Show a generation."""
        self.done += 1
        a_generation = (monotonic() - self._began) / (self.done - self._before)
        self._print_cells(self._row(step, a_generation * (self.generations - self.done)))

    def _row(self, step: Step, seconds_left: float) -> Iterable[str]:
        """The cells of a generation."""
        s, guidance = step.record.snapshot, step.record.guidance
        yield f"{s.generation}/{self.generations - 1}"
        yield in_points(s.fitness_max)
        yield in_points(s.fitness_mean)
        yield f"{s.diversity:.2f}"
        yield f"{s.working:.2f}"
        yield from (str(s.tiers[name]) for name in self.milestones)
        if self.rate:
            rate = "" if guidance is None else f"{guidance.applied_rate:.2f}"
            yield rate + "!" * bool(guidance and guidance.crisis)
        yield "" if guidance is None else duration(seconds_left)

    def _print_cells(self, cells: Iterable[str]) -> None:
        pairs = zip(cells, self._widths, strict=True)
        self._print("  ".join(f"{cell:>{width}}" for cell, width in pairs))

    def _print(self, line: str) -> None:
        if self.mode != "off":
            print(line.rstrip(), file=sys.stderr, flush=True)
