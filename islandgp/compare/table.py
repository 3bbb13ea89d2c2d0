"""Tables of a report: texts in a data frame, and the formats of numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from math import isinf, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import yaml

from islandgp.statistics import Interval, mean_sd

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart


@dataclass(frozen=True, slots=True)
class Table:
    """A table with formatted cells; exact numbers are in runs.csv, tests.csv and champions.csv."""

    key: str  # file name without extension
    title: str
    frame: DataFrame  # of texts
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, key: str, title: str, rows: Iterable[Mapping[str, str]], *notes: str) -> Self:
        """A table of rows with the same columns; a missing cell is a dash."""
        from pandas import DataFrame

        return cls(key, title, DataFrame(list(rows)).fillna(NONE), notes)


def note(key: str, **values: object) -> str:
    """A note below a table, or a paragraph, from texts.yaml, filled in with `values`."""
    return str(_texts()[key]).format(**values)


@cache
def _texts() -> Any:
    return yaml.safe_load(Path(__file__).with_name("texts.yaml").read_text(encoding="utf-8"))


MINUS: Final = "\N{MINUS SIGN}"
NONE: Final = "\N{EN DASH}"
NEVER: Final = "\N{INFINITY}"
DIGITS: Final = {"points": 0, "generations without one": 1, "Eq. (3)": 3, "rate": 3, "count": 1}
"""Number of decimals by unit."""


def number(x: float | None, digits: int = 0, sign: str = "") -> str:
    """A number as 12,345 or 12,345.6; a dash for None or nan, a sign for infinity."""
    if x is None or isnan(x):
        return NONE
    if isinf(x):
        return NEVER if x > 0 else f"{MINUS}{NEVER}"
    text = f"{x:{sign},.{digits}f}"
    if not text.strip("+-0.,"):
        text = text.lstrip("+-")  # no "-0"
    return text.replace("-", MINUS)


def spread(values: Sequence[float], digits: int = 0) -> str:
    """Mean ± standard deviation; the mean alone of a single value, a dash of none."""
    if not len(values):
        return NONE
    mean, sd = mean_sd(values)
    return number(mean, digits) + ("" if isnan(sd) else f" ± {number(sd, digits)}")


def interval(i: Interval, digits: int = 0, sign: str = "") -> str:
    """An estimate with its interval; a dash for unknown values."""
    if isnan(i.estimate):
        return NONE
    ends = NONE if isnan(i.low) else f"{number(i.low, digits)}, {number(i.high, digits)}"
    return f"{number(i.estimate, digits, sign)} [{ends}]"


def percent(share: float | None, sign: str = "") -> str:
    """A share in percent."""
    if share is None or isnan(share):
        return NONE
    return f"{share:{sign}.1%}".replace("-", MINUS).replace("%", " %")


def change(a: float, b: float, sd: float = 0.0) -> float | None:
    """The relative difference of a and b; None if it is not meaningful.

    It is meaningful if a >= 0, b > 0, and b is at least its standard deviation over runs.
    """
    return (a - b) / b if a >= 0 and b > 0 and not b < sd else None


def probability(p: float | None) -> str:
    """A p-value with three decimals, or more for a small one."""
    if p is None or isnan(p):
        return NONE
    if p < 1e-4:
        return "< 0.0001"
    return f"{p:.3f}" if p >= 0.0095 else f"{p:.4f}"
