"""The cells that tell what the tests say of a finding."""

from __future__ import annotations

from typing import Final

from islandgp.study.findings import Finding
from islandgp.study.notation import (
    DIGITS,
    NONE,
    change,
    effect,
    number,
    percent,
    probability,
    signed,
    spread,
    tested,
)
from islandgp.study.statistics import mean_sd

TESTS: Final = ("difference", "U", "z", "p", "p BH", "r")

SIGNS: Final = (
    "Mann-Whitney U of the first arm, two-sided; p BH: Benjamini-Hochberg over the whole family"
    " of {n} comparisons; r = 1 - 2U/(n1 n2): above 0, the first arm has the lower values."
    " A difference in percent is left out where the signs differ or the second mean is nearer to"
    " zero than its SD. ± is the sample standard deviation over runs."
)


def arm_cells(f: Finding) -> tuple[str, ...]:
    """Mean and deviation of each arm."""
    digits = DIGITS[f.measure.unit]
    return tuple(spread(*mean_sd(sample), digits) for sample in f.numbers)


def difference(f: Finding) -> str:
    """By which share the means differ; by how much, where a share would say nothing."""
    (a, _), (b, sd) = (mean_sd(sample) for sample in f.numbers)
    share = change(a, b, sd)
    if share is not None:
        return percent(share)
    unit = " points" if f.measure.unit == "points" else ""
    return f"{NONE} ({signed(a - b, DIGITS[f.measure.unit])}{unit})"


def test_cells(f: Finding) -> tuple[str, ...]:
    """The difference of the means, and the rank test: the columns TESTS."""
    return (difference(f), *rank_cells(f))


def rank_cells(f: Finding) -> tuple[str, ...]:
    """The rank test alone: TESTS without the difference."""
    t = f.rank
    return number(t.u, 1), number(t.z, 2), tested(t), probability(f.rank_q), effect(t.r)
