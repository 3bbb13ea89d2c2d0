"""Tables for the terminal, split into parts if it is too narrow for all columns."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from islandgp.text import title
from islandgp.viewer.recording import digits

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart
    from rich.console import Console, JustifyMethod

GAP: Final = 2  # characters between two columns
UNLIMITED_WIDTH: Final = 100_000  # characters of a line in a file or a pipe
NUMERIC: Final = re.compile(r"[-+\d.,%\[\] ]*(of \d+)?")

Column: TypeAlias = tuple[str, Sequence[Any]]
"""The heading of a column, and its cells: texts or numbers."""


def standard_output() -> Console:
    """The standard output as a console: as wide as the terminal, or UNLIMITED_WIDTH without one."""
    from rich.console import Console

    return Console(
        highlight=False, markup=False, width=None if sys.stdout.isatty() else UNLIMITED_WIDTH
    )


def numbers(values: Sequence[float], sign: str = "") -> list[str]:
    """Numbers with the same number of decimals: none if all are whole. NaN is a dash."""
    finite = [value for value in values if isfinite(value)]
    places = 0 if all(value == int(value) for value in finite) else digits(finite)
    return ["-" if isnan(value) else f"{value:{sign},.{places}f}" for value in values]


def with_ends(interval: Sequence[float], sign: str = "") -> str:
    """An estimate with the ends of its interval: `4.0 (3.1 to 4.9)`."""
    return "{} ({} to {})".format(*numbers(interval, sign))


def compared_trees(
    rows: DataFrame, worlds: int, counters: Iterable[tuple[str, str]] = ()
) -> Iterator[Column]:
    """A row for each tree of `compare.champions.compared`, which has its `name` as a column.

    `counters`: name and heading of those that are shown.
    """

    def ends(name: str, sign: str = "") -> list[str]:
        columns = rows[[name, f"{name}_low", f"{name}_high"]]
        return [with_ends(each, sign) for each in columns.to_numpy().tolist()]

    yield "tree", [*rows["name"]]
    yield "fitness (95 %)", ends("points")
    yield "difference (95 %)", ["", *ends("difference", "+")[1:]]
    yield "better in", ["", *(f"{n} of {worlds}" for n in rows["better_in"][1:])]
    for name in rows:
        if name == "feasible" or name.startswith("reached."):
            heading = title(name.removeprefix("reached."))
            yield heading.replace("Feasible", "constraints kept"), [f"{x:.0%}" for x in rows[name]]
    for heading, name in (("perturbed", "perturbed"), ("worst", "perturbed_worst")):
        if name in rows:
            yield heading, [*rows[name]]
    for name, heading in counters:
        yield heading, [*rows[f"counters.{name}"]]


def parts(columns: Sequence[Column], width: int) -> list[list[Column]]:
    """The columns as tables of at most `width` characters, each with the first column.

    A table with a single other column may be wider: its cells are folded.
    """
    first, *others = columns
    groups = [[first]]
    for column in others:
        taken = sum(GAP + max(map(len, (head, *cells))) for head, cells in (*groups[-1], column))
        if len(groups[-1]) > 1 and taken - GAP > width:
            groups.append([first])
        groups[-1].append(column)
    return groups


def print_table(console: Console, columns: Iterable[Column]) -> None:
    """Prints a table, in parts that fit the console's width, with an empty line between two.

    Numbers, intervals and counts as `3 of 30` are on the right of their column, texts on the left.
    """
    from rich.table import Table

    texts = [
        (head, [*cells] if any(isinstance(cell, str) for cell in cells) else numbers(cells))
        for head, cells in columns
    ]
    for number, part in enumerate(parts(texts, console.width)):
        if number:
            console.print()
        table = Table(box=None, padding=(0, GAP, 0, 0), pad_edge=False, header_style="bold")
        for head, cells in part:
            side: JustifyMethod = "right" if all(map(NUMERIC.fullmatch, cells)) else "left"
            table.add_column(head, justify=side, overflow="fold")
        for row in zip(*(cells for _, cells in part), strict=True):
            table.add_row(*row)
        console.print(table)
