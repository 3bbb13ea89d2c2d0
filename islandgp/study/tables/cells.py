"""The cells that tell what the tests say of a finding."""

from __future__ import annotations

from typing import Final

from islandgp.study.findings import Finding
from islandgp.study.notation import (
    DIGITS,
    change,
    effect,
    number,
    percent,
    probability,
    spread,
    tested,
)
from islandgp.study.statistics import mean_sd

TESTS: Final = ("difference", "U", "z", "p", "p BH", "r")

SIGNS: Final = (
    "Mann-Whitney U of the first arm, two-sided; p BH: Benjamini-Hochberg over the whole family"
    " of {n} comparisons; r = 1 - 2U/(n1 n2): above 0, the first arm has the lower values."
    " ± is the sample standard deviation over runs."
)


def arm_cells(f: Finding) -> tuple[str, ...]:
    """Mean and deviation of each arm."""
    digits = DIGITS[f.measure.unit]
    return tuple(spread(*mean_sd(sample), digits) for sample in f.numbers)


def test_cells(f: Finding) -> tuple[str, ...]:
    """The difference of the means, and the rank test: the columns TESTS."""
    (a, _), (b, _) = (mean_sd(sample) for sample in f.numbers)
    return (percent(change(a, b)), *rank_cells(f))


def rank_cells(f: Finding) -> tuple[str, ...]:
    """The rank test alone: TESTS without the difference."""
    t = f.rank
    return number(t.u, 1), number(t.z, 2), tested(t), probability(f.rank_q), effect(t.r)
