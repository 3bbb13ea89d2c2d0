"""The formats of numbers in tables."""

from __future__ import annotations

from collections.abc import Iterable
from math import isinf, isnan
from typing import Final

import numpy as np

from islandgp.statistics import Interval, mean_sd

MINUS: Final = "\N{MINUS SIGN}"
NONE: Final = "\N{EN DASH}"
NEVER: Final = "\N{INFINITY}"
DIGITS: Final = {"points": 0, "generations without one": 1, "Eq. (3)": 3, "rate": 3, "count": 1}
"""Number of decimals by unit."""


def number(x: float, digits: int = 0, sign: str = "") -> str:
    """A number as 12,345 or 12,345.6; a dash for nan, a sign for infinity."""
    if isnan(x):
        return NONE
    if isinf(x):
        return NEVER if x > 0 else f"{MINUS}{NEVER}"
    text = f"{x:{sign},.{digits}f}"
    if not text.strip("+-0.,"):
        text = text.lstrip("+-")  # no "-0"
    return text.replace("-", MINUS)


def spread(values: Iterable[float], digits: int = 0) -> str:
    """Mean ± standard deviation of the known values; the mean alone of one, a dash of none."""
    known = [x for x in np.asarray([*values], float).tolist() if not isnan(x)]
    if not known:
        return NONE
    mean, sd = mean_sd(known)
    return number(mean, digits) + ("" if isnan(sd) else f" ± {number(sd, digits)}")


def interval(i: Interval, digits: int = 0, sign: str = "") -> str:
    """An estimate with its interval; a dash for unknown values."""
    if isnan(i.estimate):
        return NONE
    ends = NONE if isnan(i.low) else f"{number(i.low, digits)}, {number(i.high, digits)}"
    return f"{number(i.estimate, digits, sign)} [{ends}]"


def percent(share: float, sign: str = "") -> str:
    """A share in percent; a dash for nan."""
    if isnan(share):
        return NONE
    return f"{share:{sign}.1%}".replace("-", MINUS).replace("%", " %")


def probability(p: float) -> str:
    """A p-value with three decimals, or more for a small one; a dash for nan."""
    if isnan(p):
        return NONE
    if p < 1e-4:
        return "< 0.0001"
    return f"{p:.3f}" if p >= 0.0095 else f"{p:.4f}"
