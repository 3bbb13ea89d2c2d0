"""The tests of section 3.1: Mann-Whitney U, Eq. (9), Benjamini-Hochberg, effect size r.

Further: the signed-rank test for arms that share seeds, 95 % intervals, and power: the smallest
difference that a test with a number of runs detects with probability 80 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, nan, pi, sqrt
from statistics import fmean, stdev
from typing import Any, Final, NamedTuple

import numpy as np

EXACT: Final = "exact"
EXACT_TIES: Final = "exact, ties enumerated"
ASYMPTOTIC: Final = "asymptotic, corrected for ties and continuity"
UNTESTED: Final = "no test: all values are equal"
ENUMERATED: Final = 100  # most values with ties for an exact p-value
DECIMALS: Final = 9  # of ranked values, as points of 50,000 have rounding errors in the eleventh


@dataclass(frozen=True, slots=True)
class RankTest:
    """A two-sided rank test of two independent samples."""

    u: float  # Eq. (9) for the first sample, in [0, n1 n2]; half a point for a tie
    p: float
    kind: str  # EXACT, EXACT_TIES, ASYMPTOTIC or UNTESTED
    r: float  # 1 - 2U/(n1 n2), in [-1, 1]; above 0: the first sample has the lower values


@dataclass(frozen=True, slots=True)
class PairedTest:
    """A two-sided test of two samples paired by seed."""

    p: float
    kind: str
    pairs: int
    lower: int  # pairs in which the first sample has the lower value
    higher: int  # pairs in which it has the higher one


class Interval(NamedTuple):
    """An estimate with its 95 % interval."""

    estimate: float  # all three may be infinite; nan: unknown
    low: float
    high: float


def rank_test(
    first: Sequence[float], second: Sequence[float], *, enumerated: int = ENUMERATED
) -> RankTest:
    """Mann-Whitney U: exact, or asymptotic for more than `enumerated` values with ties.

    The result has the kind of test. With `enumerated=0`, tied samples of any size have the normal
    approximation, as in the paper (section 3.1).
    """
    x, y = np.round(first, DECIMALS), np.round(second, DECIMALS)
    n1, n2 = len(x), len(y)
    u = float(np.sum(x[:, None] > y) + np.sum(x[:, None] == y) / 2)
    ranks = doubled_ranks(np.concatenate([x, y]))
    distinct = len({*ranks.tolist()})
    if distinct == 1:
        return RankTest(u, 1.0, UNTESTED, 0.0)
    if distinct == n1 + n2:
        p, kind = float(_stats().mannwhitneyu(x, y, method="exact").pvalue), EXACT
    elif n1 + n2 <= enumerated:
        p, kind = two_sided(sums_of_splits(ranks, n1), int(ranks[:n1].sum())), EXACT_TIES
    else:
        p, kind = float(_stats().mannwhitneyu(x, y, method="asymptotic").pvalue), ASYMPTOTIC
    return RankTest(u, p, kind, 1 - 2 * u / (n1 * n2))


def paired_test(
    first: Sequence[float], second: Sequence[float], *, enumerated: int = ENUMERATED
) -> PairedTest:
    """Wilcoxon's signed-rank test of pairs in the same order; equal pairs are dropped.

    Exact, or asymptotic for more than `enumerated` differences with ties.
    """
    difference = np.round(np.asarray(first, float) - np.asarray(second, float), DECIMALS)
    lower, higher = int(np.sum(difference < 0)), int(np.sum(difference > 0))
    moved = difference[difference != 0]
    if not len(moved):
        return PairedTest(1.0, UNTESTED, len(difference), 0, 0)
    tied = len(np.unique(np.abs(moved))) < len(moved) or len(moved) < len(difference)
    if not tied:
        p, kind = float(_stats().wilcoxon(moved, method="exact").pvalue), EXACT
    elif len(moved) <= enumerated:
        ranks = doubled_ranks(np.abs(moved))
        p, kind = two_sided(sums_of_subsets(ranks), int(ranks[moved > 0].sum())), EXACT_TIES
    else:
        p = float(_stats().wilcoxon(moved, method="approx", correction=True).pvalue)
        kind = ASYMPTOTIC
    return PairedTest(p, kind, len(difference), lower, higher)


def benjamini_hochberg(p: Sequence[float]) -> tuple[float, ...]:
    """p-values adjusted for the false discovery rate over a family, in the same order."""
    if not p:
        return ()
    return tuple(float(q) for q in _stats().false_discovery_control(p, method="bh"))


def mean_interval(values: Sequence[float]) -> Interval:
    """The mean with Student's t interval, whose ends are nan for a single value."""
    n, mean = len(values), fmean(values)
    if n < 2:
        return Interval(mean, nan, nan)
    from scipy.special import stdtrit  # type: ignore[import-untyped] # scipy ships no types

    half = float(stdtrit(n - 1, 0.975)) * stdev(values) / sqrt(n)
    return Interval(mean, mean - half, mean + half)


def paired_difference(first: Sequence[float], second: Sequence[float]) -> Interval:
    """Mean difference of pairs in the same order, with Student's t interval."""
    return mean_interval([a - b for a, b in zip(first, second, strict=True)])


def mean_difference(first: Sequence[float], second: Sequence[float]) -> Interval:
    """Mean of the first minus mean of the second, with Welch's t interval."""
    from scipy.special import stdtrit

    (a, s), (b, t) = mean_sd(first), mean_sd(second)
    x, y = s**2 / len(first), t**2 / len(second)
    if not x + y > 0:  # both are constant, or one is a single value
        return Interval(a - b, a - b + x + y, a - b + x + y)
    freedom = (x + y) ** 2 / (x**2 / (len(first) - 1) + y**2 / (len(second) - 1))
    half = float(stdtrit(freedom, 0.975)) * sqrt(x + y)
    return Interval(a - b, a - b - half, a - b + half)


def mean_sd(values: Sequence[float]) -> tuple[float, float]:
    """Mean and sample standard deviation (n - 1); the latter is nan for one value."""
    a = np.asarray(values, float)
    return float(a.mean()), float(a.std(ddof=1)) if len(a) > 1 else nan


# Exact p-values for tied samples, by counting all assignments of the ranks. This is the
# shift algorithm of Streitberg and Roehmel, "Exact distributions for permutation and rank
# tests", Statistical Software Newsletter 12 (1986) 10-17: a value enters as its mid-rank,
# doubled so that it is a whole number, and shifts the counts of all sums that were reached
# without it. Sixty values take some milliseconds; SciPy's permutations of them would take years.


def doubled_ranks(values: Any) -> Any:
    """Mid-ranks from 1, times two."""
    return np.rint(2 * _stats().rankdata(values)).astype(int)


def sums_of_splits(ranks: Any, n: int) -> Any:
    """The number of choices of `n` ranks with each sum, from 0."""
    ways = np.zeros((n + 1, int(ranks.sum()) + 1))  # ranks chosen x their sum
    ways[0, 0] = 1
    for rank in ranks:
        ways[1:, rank:] += ways[:-1, : ways.shape[1] - rank].copy()
    return ways[n]


def sums_of_subsets(weights: Any) -> Any:
    """The number of subsets of whole numbers >= 0 with each sum, from 0."""
    ways = np.zeros(int(weights.sum()) + 1)
    ways[0] = 1
    for weight in weights:
        ways[weight:] += ways[: len(ways) - weight].copy()
    return ways


def two_sided(ways: Any, observed: int) -> float:
    """Twice the smaller tail at the sum `observed`, at most 1; `ways` are counts by sum."""
    tail = min(ways[: observed + 1].sum(), ways[observed:].sum())
    return min(1.0, float(2 * tail / ways.sum()))


def _stats() -> Any:
    """scipy.stats, which takes two seconds to import."""
    import scipy.stats  # type: ignore[import-untyped] # scipy ships no types

    return scipy.stats


LEVEL: Final = 0.05  # section 3.1: alpha


def detectable_shift(n1: int, n2: int | None = None) -> float:
    """The smallest difference that a rank test at LEVEL finds with a power of 80 %.

    By the normal approximation with the tests' efficiency for normal values, pi / 3. It is within
    8 % of simulations for 6 to 60 runs.

    Args:
        n1: number of runs of an arm; of pairs, at least 4, without `n2`.
        n2: of the other arm.

    Returns:
        The difference in standard deviations of the runs, or of the pairs' differences.
    """
    share = 1 / (n1 - 3) if n2 is None else 1 / n1 + 1 / n2
    return 2.8 * sqrt(share * pi / 3)


def least_p(n1: int, n2: int | None = None) -> float:
    """The smallest p of the exact rank test of n1 and n2 values; without `n2`, of n1 pairs."""
    return min(1.0, 2 / (2**n1 if n2 is None else comb(n1 + n2, n1)))
