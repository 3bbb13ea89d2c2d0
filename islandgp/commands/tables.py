"""Tables on the terminal, in parts where it is too narrow for all columns."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite, isnan
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rich.console import Console, JustifyMethod

GAP: Final = 2  # letters between two columns
ENDLESS: Final = 100_000  # letters of a line where the output is a file or a pipe


def standard_output() -> Console:
    """The standard output: as wide as the terminal, or endless where it is none."""
    from rich.console import Console

    return Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else ENDLESS)


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    heading: str
    cells: tuple[str, ...]
    right: bool = True  # the side to which it is set
    must: bool = True  # it is shown however narrow the terminal is

    @property
    def width(self) -> int:
        """Letters that it takes."""
        return max(len(text) for text in (self.heading, *self.cells))


def width_of(columns: Sequence[Column]) -> int:
    """Letters of a line of a table."""
    return sum(column.width + GAP for column in columns) - GAP


def parts(columns: Sequence[Column], width: int) -> list[list[Column]]:
    """The columns as tables of at most `width` letters, each with the first column again.

    A table that holds but one other column may be wider: its cells are folded.
    """
    first, *others = columns
    groups = [[first]]
    for column in others:
        if len(groups[-1]) > 1 and width_of([*groups[-1], column]) > width:
            groups.append([first])
        groups[-1].append(column)
    return groups


def fitting(columns: Sequence[Column], width: int) -> tuple[list[Column], list[str]]:
    """The columns that a line of `width` letters has room for, and the headings of the others."""
    room = width - width_of([column for column in columns if column.must])
    shown, left_out = [], []
    for column in columns:
        if not column.must:
            room -= column.width + GAP
            if room < 0:
                left_out.append(column.heading)
                continue
        shown.append(column)
    return shown, left_out


def numbers(values: Sequence[float]) -> list[str]:
    """Numbers of one kind with the same digits: none behind the point if all of them are whole.

    What is not known (nan) is a dash.
    """
    from islandgp.viewer.recording import digits

    finite = [value for value in values if isfinite(value)]
    places = 0 if all(value == int(value) for value in finite) else digits(finite)
    return ["-" if isnan(value) else f"{value:,.{places}f}" for value in values]


def print_table(console: Console, columns: Sequence[Column]) -> None:
    """A table in as many parts as the console's width asks for, an empty line between two."""
    from rich.table import Table

    for number, part in enumerate(parts(columns, console.width)):
        if number:
            console.print()
        table = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False, header_style="bold")
        for column in part:
            side: JustifyMethod = "right" if column.right else "left"
            table.add_column(column.heading, justify=side, overflow="fold")
        for row in zip(*(column.cells for column in part), strict=True):
            table.add_row(*row)
        console.print(table)
