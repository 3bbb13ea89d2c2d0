"""The bootstrap of the studies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, floor, nan
from typing import Any, Final

import numpy as np

from islandgp.statistics import Interval

RESAMPLES: Final = 10_000  # of a bootstrap
MIN_VALUES: Final = 10  # least values of a bootstrap sample; with 3, the interval covers only 80 %
BOOTSTRAP_SEED: Final = 20_240_901  # makes reports reproducible


def bootstrap(samples: Sequence[Sequence[float]], statistic: Callable[..., Any]) -> Interval:
    """A statistic of one or several samples with its percentile bootstrap interval.

    Each sample is resampled independently. `statistic` takes one array per sample and reduces the
    last axis. Values may be infinite. A resample whose statistic is nan widens the interval, as it
    may have any value. If a sample has fewer than MIN_VALUES values, the interval is nan.
    """
    if min(map(len, samples)) < MIN_VALUES:
        with np.errstate(invalid="ignore"):
            return Interval(float(statistic(*(np.asarray(s, float) for s in samples))), nan, nan)
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    arrays = [np.asarray(s, float) for s in samples]
    resamples = [a[rng.integers(len(a), size=(RESAMPLES, len(a)))] for a in arrays]
    with np.errstate(invalid="ignore"):  # infinite minus infinite is nan: nothing is known
        values, estimate = statistic(*resamples), float(statistic(*arrays))
    unknown = np.isnan(values)
    low = _percentile(np.where(unknown, -np.inf, values), 0.025)
    high = _percentile(np.where(unknown, np.inf, values), 0.975)
    return Interval(estimate, low, high)


def _percentile(values: Any, share: float) -> float:
    """The quantile by linear interpolation; neighbours may be infinite."""
    at = share * (len(values) - 1)
    a, b = np.sort(values)[[floor(at), ceil(at)]]
    return float(a if a == b or np.isinf(a) else a + (b - a) * (at - floor(at)))
