"""Progress of a run: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from time import monotonic
from typing import TYPE_CHECKING, Final, Literal, Self

from islandgp.gp.record import Step
from islandgp.text import in_points

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live  # imported where it is used, as it costs start-up time

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

DISPENSABLE: Final = ("working", "mean", "diversity")
"""Columns that are left out on a narrow terminal, the first one first."""

OTHER_LINES: Final = 4  # other lines of the terminal: title, head, bar, cursor
MIN_ROWS: Final = 3  # least number of generations in the live table


def columns(milestones: Sequence[str], *, rate: bool = True) -> dict[str, int]:
    """Names and widths of all columns; with the mutation rate if `rate` is True."""
    *first, mutation, time_left = COLUMNS.items()
    names = [f"{name} tier" if name in COLUMNS else name for name in milestones]
    milestone_columns = ((name, max(4, len(name))) for name in names)
    return dict([*first, *milestone_columns, *[mutation] * rate, time_left])


def fitting(widths: Mapping[str, int], room: int) -> tuple[list[str], list[str]]:
    """The columns that fit into `room` characters, and those left out.

    Columns are left out in the order of DISPENSABLE, then milestones, the easiest first.
    """
    columns = list(widths)
    milestone_names = [name for name in widths if name not in COLUMNS]
    for name in (*DISPENSABLE, *milestone_names, "mutation", "time left", "best"):
        if sum(widths[other] + 1 for other in columns) - 1 <= room:
            break
        columns.remove(name)
    return columns, [name for name in widths if name not in columns]


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
    """Shows the progress of a run. A context manager; nothing is printed before it is entered."""

    mode: Literal["auto", "plain", "off"]
    """auto: a live table on a terminal, else lines; plain: lines; off: no output."""
    generations: int  # number of all generations, >= 1
    title: str  # first line
    milestones: Sequence[str]  # tiers with a column
    _: KW_ONLY
    rate: bool = True  # the search uses the mutation rate, which then has a column
    done: int = 0  # generations shown so far; at first those before a resumed run continues
    keep: bool = True  # the live table stays on the terminal at the end
    rows: list[tuple[str, ...]] = field(default_factory=list, init=False)
    columns: dict[str, int] = field(init=False)  # names and widths
    _before: int = field(init=False)  # generations before a resumed run continues
    _began: float = field(default_factory=monotonic, init=False)
    _live: Live | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.columns = columns(self.milestones, rate=self.rate)
        self._before = self.done
        if self.mode == "auto" and sys.stderr.isatty():
            from rich.console import Console
            from rich.live import Live

            console = Console(stderr=True)
            self._live = Live(console=console, refresh_per_second=4, transient=not self.keep)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
            self._live.update(self.drawn(self._live.console.height))
        elif self.mode != "off":
            resumed = f" (from generation {self.done})" if self.done else ""
            _say(f"{self.title}{resumed}")
            _say("  ".join(f"{name:>{width}}" for name, width in self.columns.items()))
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, step: Step) -> None:
        """Show a generation."""
        self.done += 1
        a_generation = (monotonic() - self._began) / (self.done - self._before)
        seconds_left = a_generation * (self.generations - self.done)
        self.rows.append(row(step, self.generations, seconds_left, self.milestones, rate=self.rate))
        if self._live is not None:
            self._live.update(self.drawn(self._live.console.height))
        elif self.mode != "off":
            cells = zip(self.rows[-1], self.columns.values(), strict=True)
            _say("  ".join(f"{cell:>{width}}" for cell, width in cells).rstrip())

    def drawn(self, height: int) -> RenderableType:
        """The table of the last generations, for a terminal of `height` lines."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        room = self._live.console.width if self._live is not None else 80
        rows = [
            dict(zip(self.columns, cells, strict=True))
            for cells in self.rows[-max(MIN_ROWS, height - OTHER_LINES) :]
        ]
        widths = {
            name: max([width, *(len(cells[name]) for cells in rows)])
            for name, width in self.columns.items()
        }
        columns, hidden = fitting(widths, room)
        table = Table(title=self.title, title_justify="left", box=None, padding=(0, 1, 0, 0))
        table.pad_edge = False
        table.caption = f"no room for {', '.join(hidden)}" if hidden else None
        table.caption_justify = "left"
        for name in columns:
            table.add_column(name, justify="right", min_width=widths[name], no_wrap=True)
        for cells in rows:
            table.add_row(*(cells[name] for name in columns))
        bar = ProgressBar(total=self.generations, completed=self.done, width=min(60, room))
        return Group(table, bar)


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
