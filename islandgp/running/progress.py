"""Progress of a run: a line for each generation."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from time import monotonic
from typing import Final, Literal

from islandgp.gp.record import Step
from islandgp.text import in_points

COLUMNS: Final = {
    "generation": 10,
    "best": 9,
    "mean": 9,
    "diversity": 9,
    "working": 7,
    "mutation": 8,
    "time left": 9,
}
"""Names and widths of columns. Before `mutation` each milestone has a column with the number of
individuals in that tier. `mutation` is the mutation rate of the next generation, with a "!" if a
crisis enforces it; only searches that use the rate have it. `time left` is estimated."""


def columns(milestones: Sequence[str], *, rate: bool = True) -> dict[str, int]:
    """Names and widths of all columns; with the mutation rate if `rate` is True."""
    *first, mutation, time_left = COLUMNS.items()
    names = [f"{name} tier" if name in COLUMNS else name for name in milestones]
    milestone_columns = ((name, max(4, len(name))) for name in names)
    return dict([*first, *milestone_columns, *[mutation] * rate, time_left])


def row(
    step: Step,
    generations: int,
    seconds_left: float,
    milestones: Sequence[str],
    *,
    rate: bool = True,
) -> tuple[str, ...]:
    """The cells of one generation in `columns`."""
    s = step.record.snapshot
    guidance = step.record.guidance
    mutation = ""
    if guidance is not None:
        mutation = f"{guidance.applied_rate:.2f}{'!' * bool(guidance.crisis)}"
    return (
        f"{s.generation}/{generations - 1}",
        in_points(s.fitness_max),
        in_points(s.fitness_mean),
        f"{s.diversity:.2f}",
        f"{s.working:.2f}",
        *(str(s.tiers[name]) for name in milestones),
        *[mutation] * rate,
        duration(seconds_left) if guidance is not None else "",
    )


def duration(seconds: float) -> str:
    """A duration as text: `8 s`, `3 min 05 s`, `2 h 07 min`, `3 d 04 h`."""
    total = max(0, round(seconds))
    if total < 60:
        return f"{total} s"
    for unit, small, size, limit in (("min", "s", 60, 60), ("h", "min", 3600, 24)):
        if total < size * limit:
            return f"{total // size} {unit} {total % size * 60 // size:02d} {small}"
    return f"{total // 86400} d {total % 86400 // 3600:02d} h"


@dataclass(slots=True)
class Progress:
    """Shows the progress of a run on the error stream, unless `mode` is off."""

    mode: Literal["plain", "off"]
    generations: int  # number of all generations, >= 1
    title: str  # first line
    milestones: Sequence[str]  # tiers with a column
    _: KW_ONLY
    rate: bool = True  # the search uses the mutation rate, which then has a column
    done: int = 0  # generations shown so far; at first those before a resumed run continues
    _before: int = field(init=False)  # generations before a resumed run continues
    _began: float = field(default_factory=monotonic, init=False)

    def __post_init__(self) -> None:
        self._before = self.done

    def begin(self) -> None:
        """Show the title and the head of the table."""
        resumed = f" (from generation {self.done})" if self.done else ""
        self._say(f"{self.title}{resumed}")
        self._cells(list(columns(self.milestones, rate=self.rate)))

    def show(self, step: Step) -> None:
        """Show a generation."""
        self.done += 1
        a_generation = (monotonic() - self._began) / (self.done - self._before)
        seconds_left = a_generation * (self.generations - self.done)
        self._cells(row(step, self.generations, seconds_left, self.milestones, rate=self.rate))

    def _cells(self, cells: Sequence[str]) -> None:
        widths = columns(self.milestones, rate=self.rate).values()
        self._say("  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True)))

    def _say(self, line: str) -> None:
        if self.mode != "off":
            print(line.rstrip(), file=sys.stderr, flush=True)
