"""The bootstrap of the studies, on samples whose intervals are known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from studies.resampling import bootstrap


def median_difference(x: Any, y: Any) -> Any:
    """A statistic of two samples."""
    return np.median(x, axis=-1) - np.median(y, axis=-1)


def test_bootstrap_is_seeded_and_holds_its_estimate() -> None:
    """The same samples give the same interval, around the estimate; constants give a point."""
    x, y = [1.0, 2.0, 3.0, 9.0] * 3, [2.0, 4.0, 4.0, 5.0] * 3
    interval = bootstrap([x, y], median_difference)
    assert interval == bootstrap([x, y], median_difference)
    assert interval.low <= interval.estimate == -1.5 <= interval.high
    same = bootstrap([[7.0] * 10, [4.0] * 10], median_difference)
    assert (same.low, same.estimate, same.high) == (3, 3, 3)


def test_bootstrap_with_censored_runs() -> None:
    """An infinite value makes an end infinite; where both medians are, anything is possible."""
    inf = math.inf
    difference = bootstrap([[1.0, 2.0] * 5, [inf] * 10], median_difference)
    assert (difference.low, difference.estimate, difference.high) == (-inf, -inf, -inf)
    unknown = bootstrap([[inf] * 10, [inf] * 10], median_difference)
    assert (unknown.low, unknown.high) == (-inf, inf)
    assert math.isnan(unknown.estimate)


def test_bootstrap_interval_of_a_mean_is_as_wide_as_in_theory() -> None:
    """For 400 normal values the 95 % interval of the mean is about 2 x 1.96 / 20 wide."""
    x = np.random.default_rng(0).normal(size=400)
    interval = bootstrap([list(x)], lambda a: a.mean(axis=-1))
    assert interval.high - interval.low == pytest.approx(0.196, rel=0.1)


def test_a_small_sample_is_not_bootstrapped() -> None:
    """Of fewer than ten values there is an estimate and no interval."""
    interval = bootstrap([[7.0] * 9, [1.0, 2.0] * 5], median_difference)
    assert interval.estimate == 5.5
    assert math.isnan(interval.low)
    assert math.isnan(interval.high)
