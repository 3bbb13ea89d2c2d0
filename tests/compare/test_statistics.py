"""The tests of section 3.1 on numbers whose answers are known."""

from __future__ import annotations

import math
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.statistics import (
    ASYMPTOTIC,
    EXACT,
    EXACT_TIES,
    UNTESTED,
    benjamini_hochberg,
    detectable_shift,
    least_p,
    mean_difference,
    mean_interval,
    paired_difference,
    paired_test,
    rank_test,
)


def _samples_with(u: int) -> tuple[list[float], list[float]]:
    """Two samples of five without ties whose U is `u`."""
    second = [10.0, 20.0, 30.0, 40.0, 50.0]
    wins = [min(5, max(0, u - 5 * i)) for i in range(5)]  # how many of `second` each one exceeds
    return [10.0 * w + 5 + i / 10 for i, w in enumerate(wins)], second


@pytest.mark.parametrize(
    ("u", "p", "r"), [(12, 1.000, 0.04), (8, 0.421, 0.36), (21, 0.095, -0.68), (1, 0.016, 0.92)]
)
def test_table_9_follows_from_its_u(u: int, p: float, r: float) -> None:
    """U = 12, 8, 21 and 1 at n = 5 and 5 give the exact p and the r that Table 9 prints."""
    test = rank_test(*_samples_with(u))
    assert test.u == u
    assert test.kind == EXACT
    assert round(test.p, 3) == p
    assert round(test.r, 2) == r


def test_ties_are_counted_out() -> None:
    """Three equal values below three equal ones: 2 of the 20 splits are as far apart."""
    test = rank_test([2, 2, 2], [3, 3, 3])
    assert (test.kind, test.p, test.u) == (EXACT_TIES, pytest.approx(0.1), 0)
    # 1 1 2 | 2 3 3: ranks 1.5 1.5 3.5 | 3.5 5.5 5.5, sum 6.5. Of the 20 splits two have
    # 1.5 + 1.5 + 3.5, the least sum there is: p = 2 x 2 / 20.
    assert rank_test([1, 1, 2], [2, 3, 3]).p == pytest.approx(0.2)


def test_floating_point_noise_breaks_no_tie() -> None:
    """0.1 + 0.2 ties with 0.3, and so do two ways to add up 50,000 points."""
    noisy = 0.1 + 0.2
    assert noisy != 0.3
    assert rank_test([noisy, noisy], [0.3, 0.3]).kind == UNTESTED
    assert rank_test([50_000 + 7e-12], [50_000]).kind == UNTESTED
    assert rank_test([0.3, 1.0], [noisy, 2.0]).u == 1.5
    assert paired_test([noisy, 1.0], [0.3, 2.0]).lower == 1
    # Both differences are 0.1, up to noise: a tie of two, counted as such.
    assert paired_test([0.3, 0.4], [0.2, 0.3]) == paired_test([3, 4], [2, 3])


def test_many_ties_are_approximated() -> None:
    """Beyond the number of values to enumerate the kind is named as asymptotic."""
    test = rank_test([11, 10, 5, 5, 17], [17, 27, 36, 30, 28], enumerated=9)
    assert test.kind == ASYMPTOTIC
    assert test.u == 0.5
    assert rank_test([0.0, 1.0] * 30, [1.0] * 41).kind == ASYMPTOTIC


@given(
    st.lists(st.integers(0, 4).map(float), min_size=2, max_size=5),
    st.lists(st.integers(0, 4).map(float), min_size=2, max_size=5),
)
def test_the_count_is_that_of_all_splits(x: list[float], y: list[float]) -> None:
    """The same p as from listing every split of the values and its U."""

    def u(a: list[float], b: list[float]) -> float:
        return sum((v > w) + (v == w) / 2 for v in a for w in b)

    test = rank_test(x, y)
    if test.kind != EXACT_TIES:
        return
    every = x + y
    statistics = []
    for indices in combinations(range(len(every)), len(x)):
        rest = [every[i] for i in range(len(every)) if i not in indices]
        statistics.append(u([every[i] for i in indices], rest))
    tail = min(sum(v <= test.u for v in statistics), sum(v >= test.u for v in statistics))
    assert test.p == pytest.approx(min(1, 2 * tail / len(statistics)))


def test_equal_values_are_not_tested() -> None:
    """Equal values are not tested: p is 1 and the kind gives the reason."""
    test = rank_test([3, 3], [3, 3, 3])
    assert (test.p, test.r, test.kind) == (1.0, 0.0, UNTESTED)


numbers = st.lists(st.integers(-50, 50).map(float), min_size=1, max_size=12)


@given(numbers, numbers)
def test_the_order_of_the_arms_changes_signs_only(x: list[float], y: list[float]) -> None:
    """Exchanging the samples gives U' = n1 n2 - U, the same p, and the opposite r."""
    a, b = rank_test(x, y), rank_test(y, x)
    assert a.u + b.u == len(x) * len(y)
    assert a.p == pytest.approx(b.p)
    assert a.r == pytest.approx(-b.r)


def test_benjamini_hochberg_by_hand() -> None:
    """p = .01 .04 .03 .005 of four: .02 .04 .04 .02, in the order in which they came."""
    assert benjamini_hochberg([0.01, 0.04, 0.03, 0.005]) == pytest.approx((0.02, 0.04, 0.04, 0.02))
    assert benjamini_hochberg([]) == ()


def test_wilcoxon_is_exact_without_ties() -> None:
    """Five pairs that all fall: the smallest exact p there is, 2 / 2**5."""
    test = paired_test([1, 2, 3, 4, 5], [2, 4, 6, 8, 10])
    assert (test.kind, test.p, test.lower, test.higher) == (EXACT, 0.0625, 5, 0)


def test_pairs_that_do_not_differ() -> None:
    """Equal pairs are left out; when all are equal there is no test."""
    assert paired_test([1, 2], [1, 2]).kind == UNTESTED


def test_wilcoxon_with_ties_is_counted_out() -> None:
    """Differences -1 -1 -1 2 have ranks 2 2 2 4: the sum 4 of the positive ones is reached or
    undercut by 1 + 3 + 4 of 16 signs, so p is 1. Three that fall alike: 2 of 8."""
    mixed = paired_test([0, 0, 0, 4], [1, 1, 1, 2])
    assert (mixed.kind, mixed.p) == (EXACT_TIES, 1.0)
    assert paired_test([0, 0, 0], [1, 1, 1]).p == 0.25
    dropped = paired_test([1, 2, 3, 4], [1, 3, 5, 7])
    assert (dropped.kind, dropped.p, dropped.pairs) == (EXACT_TIES, 0.25, 4)
    assert paired_test([0, 0, 0], [1, 1, 1], enumerated=2).kind == ASYMPTOTIC


def test_single_values_have_no_interval() -> None:
    """Every interval of a single value is nan, not of zero width."""
    intervals = (
        mean_interval([3.0]),
        mean_difference([3.0], [3.0]),
        mean_difference([3.0], [1.0, 1.0]),
        paired_difference([3.0], [1.0]),
    )
    assert all(math.isnan(i.low) and math.isnan(i.high) for i in intervals)


def test_interval_of_a_mean_by_hand() -> None:
    """1 2 3: standard error 1 / sqrt(3), and t of 2 degrees of freedom is 4.303."""
    interval = mean_interval([1.0, 2.0, 3.0])
    assert interval.estimate == 2.0
    assert interval.high - 2 == pytest.approx(4.302653 / math.sqrt(3))
    assert 2 - interval.low == pytest.approx(4.302653 / math.sqrt(3))
    assert paired_difference([5.0, 7.0, 9.0], [4.0, 5.0, 6.0]) == interval
    assert math.isnan(mean_interval([1.0]).low)


def test_welch_s_interval_is_scipy_s() -> None:
    """Two samples of other sizes and deviations; constants give a point, one value none."""
    from scipy import stats  # type: ignore[import-untyped] # scipy ships no types

    x, y = [1.0, 2.0, 4.0, 9.0], [3.0, 3.5, 8.0]
    ends = stats.ttest_ind(x, y, equal_var=False).confidence_interval()
    interval = mean_difference(x, y)
    assert (interval.low, interval.high) == pytest.approx((ends.low, ends.high))
    assert mean_difference([3.0, 3.0], [1.0, 1.0]).high == 2.0
    assert math.isnan(mean_difference([3.0], [1.0, 2.0]).low)


def test_what_a_number_of_runs_can_show() -> None:
    """Three runs an arm give p = 0.1 at best; the t test needs 0.74 SD at n = 30 and 80 %."""
    assert least_p(3, 3) == pytest.approx(0.1)
    assert least_p(6) == 2 / 64
    assert detectable_shift(30, 30) == pytest.approx(0.755, abs=0.03)  # by simulation
    assert detectable_shift(33) == pytest.approx(0.52, abs=0.02)
