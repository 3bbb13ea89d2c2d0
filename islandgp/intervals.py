"""The mean of some values with its confidence interval."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan, sqrt
from statistics import fmean, stdev


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean and 95 % interval by Student's t; the ends are nan for a single value."""
    n, mean = len(values), fmean(values)
    if n < 2:
        return mean, nan, nan
    from scipy.special import stdtrit  # type: ignore[import-untyped] # scipy ships no types

    half = float(stdtrit(n - 1, 0.975)) * stdev(values) / sqrt(n)
    return mean, mean - half, mean + half
