"""Tables for the terminal, split into parts if it is too narrow for all columns."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from math import isfinite, isnan
from typing import TYPE_CHECKING, Final, NamedTuple

from islandgp.viewer.recording import digits

if TYPE_CHECKING:
    from rich.console import Console, JustifyMethod

GAP: Final = 2  # characters between two columns
UNLIMITED_WIDTH: Final = 100_000  # characters of a line in a file or a pipe


class Column(NamedTuple):
    """A column of a table."""

    heading: str
    cells: Sequence[str]
    left: bool = False  # alignment

    @property
    def width(self) -> int:
        """Width in characters, with the gap."""
        return max(map(len, (self.heading, *self.cells))) + GAP


def standard_output() -> Console:
    """The standard output as a console: as wide as the terminal, or UNLIMITED_WIDTH without one."""
    from rich.console import Console

    return Console(
        highlight=False, markup=False, width=None if sys.stdout.isatty() else UNLIMITED_WIDTH
    )


def numbers(values: Sequence[float]) -> list[str]:
    """Numbers with the same number of decimals: none if all are whole. NaN is a dash."""
    finite = [value for value in values if isfinite(value)]
    places = 0 if all(value == int(value) for value in finite) else digits(finite)
    return ["-" if isnan(value) else f"{value:,.{places}f}" for value in values]


def parts(columns: Sequence[Column], width: int) -> list[list[Column]]:
    """The columns as tables of at most `width` characters, each with the first column.

    A table with a single other column may be wider: its cells are folded.
    """
    first, *others = columns
    groups = [[first]]
    for column in others:
        if len(groups[-1]) > 1 and sum(c.width for c in (*groups[-1], column)) - GAP > width:
            groups.append([first])
        groups[-1].append(column)
    return groups


def print_table(console: Console, columns: Sequence[Column]) -> None:
    """Prints a table, in parts that fit the console's width, with an empty line between two."""
    from rich.table import Table

    for number, part in enumerate(parts(columns, console.width)):
        if number:
            console.print()
        table = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False, header_style="bold")
        for column in part:
            side: JustifyMethod = "left" if column.left else "right"
            table.add_column(column.heading, justify=side, overflow="fold")
        for row in zip(*(column.cells for column in part), strict=True):
            table.add_row(*row)
        console.print(table)
