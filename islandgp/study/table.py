"""Tables of a report: their data, CSV, and the formats of numbers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isinf, isnan, nan
from typing import Final, Self

from islandgp.statistics import EXACT, EXACT_TIES, UNTESTED, Interval, PairedTest, RankTest
from islandgp.study.aggregates import EXACT_PAIRS, ImprovementTest

Tested = RankTest | PairedTest | ImprovementTest

Row = Iterable[tuple[str, str]]
"""A row: the cell of each column."""


def labelled(heading: str, label: str, columns: Iterable[str], cells: Iterable[str]) -> Row:
    """A row of a label below a heading, and of a cell for each of the other columns."""
    return [(heading, label), *zip(columns, cells, strict=True)]


CsvRow = Iterable[tuple[str, object]]
"""A row of exact values: the value of each column; None is an empty cell."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table with formatted cells; exact numbers are in runs.csv and tests.csv."""

    key: str  # file name without extension
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, key: str, title: str, rows: Iterable[Row], *notes: str) -> Self:
        """A table of one or more rows with the same columns."""
        pairs = [list(row) for row in rows]
        columns = tuple(column for column, _ in pairs[0])
        return cls(key, title, columns, tuple(tuple(c for _, c in row) for row in pairs), notes)


def to_csv(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """The rows as CSV with a header line."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue()


def values_csv(rows: Iterable[CsvRow]) -> str:
    """One or more rows with the same columns as CSV."""
    pairs = [list(row) for row in rows]
    return to_csv([column for column, _ in pairs[0]], ([v for _, v in row] for row in pairs))


def interval_values(name: str, i: Interval | None, before_end: str = "_") -> CsvRow:
    """An estimate and the ends of its interval; None for unknown values."""
    values = (nan, nan, nan) if i is None else (i.estimate, i.low, i.high)
    columns = (name, f"{name}{before_end}low", f"{name}{before_end}high")
    return zip(columns, map(known, values), strict=True)


def known(x: float) -> float | None:
    """None (an empty cell) for nan."""
    return None if isnan(x) else x


MINUS: Final = "\N{MINUS SIGN}"
NONE: Final = "\N{EN DASH}"
NEVER: Final = "\N{INFINITY}"
DIGITS: Final = {"points": 0, "generation": 1, "Eq. (3)": 3, "rate": 3}
"""Number of decimals by unit."""


def number(x: float | None, digits: int = 0) -> str:
    """A number as 12,345 or 12,345.6; a dash for None, a sign for infinity."""
    if x is None or isnan(x):
        return NONE
    if isinf(x):
        return NEVER if x > 0 else f"{MINUS}{NEVER}"
    text = f"{x:,.{digits}f}"
    if not text.strip("-0.,"):
        text = text.lstrip("-")  # no "-0"
    return text.replace("-", MINUS)


def spread(mean: float, sd: float, digits: int = 0) -> str:
    """Mean ± standard deviation; a dash for the deviation of a single value."""
    return f"{number(mean, digits)} ± {number(sd, digits)}"


def interval(i: Interval, digits: int = 0) -> str:
    """An estimate with its interval; a dash for unknown values."""
    if isnan(i.estimate):
        return NONE
    ends = NONE if isnan(i.low) else f"{number(i.low, digits)}, {number(i.high, digits)}"
    return f"{number(i.estimate, digits)} [{ends}]"


def percent(share: float | None) -> str:
    """A signed share in percent."""
    if share is None or share != share:
        return NONE
    return f"{share:+.1%}".replace("-", MINUS).replace("%", " %")


def change(a: float, b: float, sd: float = 0.0) -> float | None:
    """The relative difference of a and b; None if it is not meaningful.

    It is meaningful if a >= 0, b > 0, and b is at least its standard deviation over runs.
    """
    return (a - b) / b if a >= 0 and b > 0 and b >= sd else None


def signed(x: float, digits: int = 0) -> str:
    """A number with its sign."""
    return f"{'+' if x > 0 else ''}{number(x, digits)}"


def signed_interval(i: Interval, digits: int = 0) -> str:
    """A difference with its sign and its interval."""
    return f"{'+' if i.estimate > 0 else ''}{interval(i, digits)}"


def probability(p: float | None) -> str:
    """A p-value with three decimals, or more for a small one."""
    if p is None:
        return NONE
    if p < 1e-4:
        return "< 0.0001"
    return f"{p:.3f}" if p >= 0.0095 else f"{p:.4f}"


def p_is(test: Tested) -> str:
    """A p-value with its kind in a sentence: p = 0.012 (exact), p < 0.0001 (exact)."""
    text = tested(test)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


_SHORT: Final = {
    EXACT: "exact",
    EXACT_TIES: EXACT_TIES,
    EXACT_PAIRS: "exact, pairs exchanged",
    UNTESTED: "all equal",
}


def kind(test: Tested) -> str:
    """The kind of a p-value, abbreviated."""
    return _SHORT.get(test.kind, "asymptotic")


def tested(test: Tested) -> str:
    """A p-value with its kind."""
    return f"{probability(test.p)} ({kind(test)})"


def effect(r: float) -> str:
    """The effect size with its sign, as in the paper."""
    return f"{r:+.2f}".replace("-", MINUS)
