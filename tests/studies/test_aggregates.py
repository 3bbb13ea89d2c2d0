"""Aggregates of scores with several peaks: by hand, as rliable has them, and their properties."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise, product
from math import isnan, nan
from statistics import fmean
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.errors import StudyError
from islandgp.statistics import EXACT, UNTESTED, Interval, rank_test
from studies.comparison.aggregates import (
    EXACT_PAIRS,
    MAX_THRESHOLDS,
    NORMAL,
    improvement_interval,
    improvement_test,
    interquartile_mean,
    mean,
    median,
    performance_profile,
    probability_of_improvement,
    stratified_bootstrap,
    thresholds,
)
from studies.comparison.strata import MAX_SCORES
from tests.profiles import examples

# Two arms with two peaks, 10 runs (rows) in 3 worlds (columns).
FIRST = (
    *((0.77, -0.07, 0.02), (0.88, 1.16, -0.03), (1.0, 0.17, -0.2), (0.98, 1.02, 1.01)),
    *((0.82, 1.01, 1.2), (0.77, -0.05, -0.06), (0.9, 0.23, 1.11), (0.82, 1.01, 1.09)),
    *((0.97, 1.1, 0.99), (-0.07, 1.22, 0.9)),
)
SECOND = (
    *((-0.1, -0.05, -0.08), (0.7, -0.06, 1.05), (0.68, 1.13, 0.74), (-0.1, -0.16, 0.05)),
    *((0.21, -0.22, 1.19), (-0.09, -0.26, 0.96), (-0.0, 0.01, -0.11), (0.92, -0.08, 0.88)),
    *((-0.17, -0.18, 1.19), (-0.08, 0.04, 1.0)),
)
A, B = (tuple(zip(*rows, strict=True)) for rows in (FIRST, SECOND))


@pytest.mark.parametrize(
    ("scores", "expected"),
    [
        ((8.0, 1.0, 7.0, 2.0, 6.0, 3.0, 5.0, 4.0), 4.5),  # of 3 4 5 6
        ((0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 100.0), 0.75),  # of 0 1 1 1
        ((1.0, 2.0, 3.0, 4.0, 5.0, 60.0), 3.5),  # one of six is left out at each end
        ((1.0, 2.0, 6.0), 3.0),
        ((5.0,), 5.0),
    ],
)
def test_interquartile_mean_by_hand(scores: tuple[float, ...], expected: float) -> None:
    """The mean of what is left when floor(n/4) scores are dropped at each end."""
    assert interquartile_mean(scores) == expected
    assert interquartile_mean([scores, scores[::-1]]).tolist() == [expected] * 2


def test_two_peaks_by_hand() -> None:
    """Nine runs at 0 and eleven at 10: median, mean and IQM are three different stories."""
    scores = [0.0] * 9 + [10.0] * 11
    assert median(scores) == 10
    assert mean(scores) == 5.5
    assert interquartile_mean(scores) == 6  # 0 x 4 and 10 x 6
    assert performance_profile([scores], [5]).share == (0.55,)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (((1.0, 3.0),), ((2.0, 3.0),), 0.375),  # 1 beats none; 3 beats 2 and ties 3
        (((1.0, 2.0),), ((3.0, 4.0),), 0.0),
        (((5.0,), (0.0, 0.0)), ((4.0,), (0.0, 1.0, 2.0)), (1 + 2 / 12) / 2),
        (((0.1 + 0.2,),), ((0.3,),), 0.5),  # a tie but for noise
    ],
)
def test_probability_of_improvement_by_hand(
    first: tuple[tuple[float, ...], ...], second: tuple[tuple[float, ...], ...], expected: float
) -> None:
    """Pairs of runs that the first arm wins, a tie counting half; the mean over worlds."""
    assert probability_of_improvement(first, second) == pytest.approx(expected)
    assert probability_of_improvement(second, first) == pytest.approx(1 - expected)


def test_a_profile_by_hand() -> None:
    """Above, and not at, each threshold; over all runs of all worlds."""
    profile = performance_profile([[1.0, 2.0], [2.0, 4.0]], [4.0, 0.0, 2.0, 1.0, 2.0])
    assert profile.thresholds == (0, 1, 2, 4)
    assert profile.share == (1, 0.75, 0.25, 0)
    assert all(isnan(x) for x in (*profile.low, *profile.high))  # four runs have no band
    assert thresholds([[2.0, 1.0]], [[3.0], [2.0]]) == (1, 2, 3)
    assert len(thresholds([np.arange(5000.0)])) == MAX_THRESHOLDS


def test_estimates_are_those_of_rliable() -> None:
    """The numbers that rliable 1.2.0 gives for these scores, and its formulas."""
    from scipy import stats  # type: ignore[import-untyped] # scipy ships no types

    assert stratified_bootstrap(A, interquartile_mean).estimate == pytest.approx(0.826875)
    assert stratified_bootstrap(B, interquartile_mean).estimate == pytest.approx(0.173125)
    assert stratified_bootstrap(A, mean).estimate == pytest.approx(0.689)
    assert probability_of_improvement(A, B) == pytest.approx(0.7483333333333334)
    assert performance_profile(A, [0, 0.25, 0.5, 0.75, 1]).share == pytest.approx(
        (0.8, 0.7, 0.7, 0.7, 1 / 3)
    )
    matrix = np.array(FIRST)
    assert interquartile_mean(matrix.ravel()) == pytest.approx(
        stats.trim_mean(matrix, proportiontocut=0.25, axis=None)
    )
    wins = [
        stats.mannwhitneyu(a, b, alternative="greater")[0] / 100 for a, b in zip(A, B, strict=True)
    ]
    assert probability_of_improvement(A, B) == pytest.approx(fmean(wins))
    assert performance_profile([matrix.ravel()], [0.75]).share == (np.mean(matrix > 0.75),)


@pytest.mark.parametrize(
    ("computed", "low", "high", "within"),
    [
        (stratified_bootstrap(A, interquartile_mean), 0.541875, 0.97625, 0.015),
        (stratified_bootstrap(B, interquartile_mean), -0.0375, 0.43125, 0.015),
        (stratified_bootstrap(A, mean), 0.52066, 0.851, 0.01),
        (improvement_interval(A, B), 0.63, 0.86, 0.015),
    ],
)
def test_intervals_are_those_of_rliable(
    computed: Interval, low: float, high: float, within: float
) -> None:
    """Up to the chance of its 3,000 to 20,000 resamples, which have no seed."""
    assert (computed.low, computed.high) == pytest.approx((low, high), abs=within)


def test_bands_are_those_of_rliable() -> None:
    """With 30 runs ends are multiples of 1/30; the draws may differ by one of them."""
    profile = performance_profile(A, [0, 0.25, 0.5, 0.75, 1])
    assert profile.low == pytest.approx((0.66667, 0.53333, 0.53333, 0.53333, 0.2), abs=0.034)
    assert profile.high == pytest.approx((0.93333, 0.86667, 0.86667, 0.86667, 0.46667), abs=0.034)


def test_pairs_are_drawn_as_pairs() -> None:
    """Where both arms follow their seed, the interval with pairs is narrower."""
    seeds = np.random.default_rng(0).normal(size=20)
    x, y = [seeds + 0.1], [seeds]
    unpaired, as_pairs = improvement_interval(x, y), improvement_interval(x, y, paired=True)
    assert unpaired.estimate == as_pairs.estimate
    assert as_pairs.high - as_pairs.low < (unpaired.high - unpaired.low) / 2


def test_bootstrap_of_a_chance_by_another_way() -> None:
    """The standard error is that of resamples that are compared run by run."""
    rng = np.random.default_rng(3)
    x, y = rng.integers(0, 5, 12).astype(float), rng.integers(0, 5, 15).astype(float)
    estimates = [
        probability_of_improvement([rng.choice(x, 12)], [rng.choice(y, 15)]) for _ in range(2000)
    ]
    low, high = np.quantile(estimates, (0.025, 0.975))
    computed = improvement_interval([x], [y])
    assert (computed.low, computed.high) == pytest.approx((low, high), abs=0.03)


scores = st.lists(st.integers(-5, 5).map(float), min_size=10, max_size=16)
worlds = st.lists(scores, min_size=1, max_size=3)
few = examples(max_examples=15, deadline=None)


@few
@given(st.floats(-1e6, 1e6), st.integers(10, 30), st.integers(1, 3))
def test_constant_scores_have_no_width(value: float, n: int, count: int) -> None:
    """A point in each interval and band; half a chance of improvement, which is a point too."""
    strata = [[value] * n] * count
    for statistic in (mean, median, interquartile_mean):
        constant = stratified_bootstrap(strata, statistic)
        assert constant.low == constant.estimate == constant.high
    assert improvement_interval(strata, strata) == Interval(0.5, 0.5, 0.5)
    profile = performance_profile(strata, [value - 1, value, value + 1])
    assert profile.low == profile.share == profile.high == (1, 0, 0)
    assert improvement_test(strata, strata).kind == UNTESTED


@few
@given(worlds)
def test_an_arm_does_not_improve_on_itself(strata: list[list[float]]) -> None:
    """One half: in the middle of its interval, and exactly where runs are drawn as pairs."""
    improvement = improvement_interval(strata, strata)
    assert improvement.estimate == 0.5
    assert improvement.low <= 0.5 <= improvement.high
    assert improvement_interval(strata, strata, paired=True) == Interval(0.5, 0.5, 0.5)
    assert improvement_test(strata, strata).p == 1.0
    assert improvement_test(strata, strata, paired=True).p == 1.0


@few
@given(worlds, st.lists(st.floats(-6, 6), min_size=1, max_size=9))
def test_a_profile_never_rises(strata: list[list[float]], at: list[float]) -> None:
    """Share and both ends of the band fall from left to right, within 0 and 1."""
    profile = performance_profile(strata, at)
    for row in (profile.share, profile.low, profile.high):
        assert all(a >= b for a, b in pairwise(row))
        assert all(0 <= x <= 1 for x in row)
    assert all(
        a <= b <= c for a, b, c in zip(profile.low, profile.share, profile.high, strict=True)
    )


@few
@given(st.data(), worlds)
def test_the_order_of_the_runs_changes_nothing(
    data: st.DataObject, strata: list[list[float]]
) -> None:
    """To the last bit: in each estimate, interval, band and p."""
    other = [[x + k % 3 for k, x in enumerate(each)] for each in strata]
    orders = [data.draw(st.permutations(range(len(each)))) for each in strata]
    moved = [[each[k] for k in order] for each, order in zip(strata, orders, strict=True)]
    along = [[each[k] for k in order] for each, order in zip(other, orders, strict=True)]
    for statistic in (mean, median, interquartile_mean):
        assert stratified_bootstrap(moved, statistic) == stratified_bootstrap(strata, statistic)
    assert improvement_interval(moved, other) == improvement_interval(strata, other)
    assert improvement_interval(moved, along, paired=True) == improvement_interval(
        strata, other, paired=True
    )
    assert performance_profile(moved, [0, 1]) == performance_profile(strata, [0, 1])
    assert improvement_test(moved, other) == improvement_test(strata, other)
    assert improvement_test(moved, along, paired=True) == improvement_test(
        strata, other, paired=True
    )


def test_draws_are_keyed_by_purpose() -> None:
    """The same scores have the same interval, with other draws in between."""
    before = improvement_interval(A, B)
    np.random.default_rng(0).random(5)
    stratified_bootstrap(B, mean)
    assert improvement_interval(A, B) == before


@pytest.mark.parametrize(
    ("strata", "has_interval"),
    [
        (((1.0,),), False),
        (((1.0, 2.0) * 4 + (1.0,),), False),  # nine
        (((1.0, 2.0) * 5,), True),
        (((1.0, 2.0, 3.0, 4.0, 5.0),) * 2, True),
        (((1.0, 2.0, 3.0, 4.0),) * 5, False),  # too few a world
    ],
)
def test_few_runs_have_no_interval(
    strata: tuple[tuple[float, ...], ...], has_interval: bool
) -> None:
    """Nan, where a percentile interval would cover too little; never a point."""
    for computed in (stratified_bootstrap(strata, mean), improvement_interval(strata, strata)):
        assert not isnan(computed.estimate)
        assert [isnan(computed.low), isnan(computed.high)] == [not has_interval] * 2


def _chance(first: Sequence[Sequence[float]], second: Sequence[Sequence[float]]) -> float:
    return round(probability_of_improvement(first, second), 9)


def _two_sided(value: float, every: Sequence[float]) -> float:
    tail = min(sum(v <= value for v in every), sum(v >= value for v in every))
    return min(1.0, 2 * tail / len(every))


@examples(max_examples=40, deadline=None)
@given(st.lists(st.tuples(*[st.integers(0, 3).map(float)] * 5), min_size=2, max_size=2))
def test_the_stratified_test_counts_all_splits(pooled: list[tuple[float, ...]]) -> None:
    """The p of listing each split of five runs into 2 and 3 in both of two worlds."""
    first, second = [each[:2] for each in pooled], [each[2:] for each in pooled]
    splits = [
        [
            ([each[i] for i in indices], [each[i] for i in range(5) if i not in indices])
            for indices in combinations(range(5), 2)
        ]
        for each in pooled
    ]
    every = [_chance([a[0], b[0]], [a[1], b[1]]) for a, b in product(*splits)]
    result = improvement_test(first, second)
    assert result.kind in (EXACT, UNTESTED)
    assert result.p == pytest.approx(_two_sided(_chance(first, second), every))


@examples(max_examples=40, deadline=None)
@given(st.lists(st.tuples(*[st.integers(0, 3).map(float)] * 6), min_size=1, max_size=2))
def test_the_test_of_pairs_counts_all_exchanges(pooled: list[tuple[float, ...]]) -> None:
    """The p of listing each way to exchange the runs of three seeds, in one world and in two."""
    first, second = [each[:3] for each in pooled], [each[3:] for each in pooled]
    ways = [
        [
            (
                [x[k] if k in indices else y[k] for k in range(3)],
                [y[k] if k in indices else x[k] for k in range(3)],
            )
            for n in range(4)
            for indices in combinations(range(3), n)
        ]
        for x, y in zip(first, second, strict=True)
    ]
    every = [_chance([w[0] for w in way], [w[1] for w in way]) for way in product(*ways)]
    result = improvement_test(first, second, paired=True)
    assert result.kind in (EXACT_PAIRS, UNTESTED)
    assert result.p == pytest.approx(_two_sided(_chance(first, second), every))


def test_one_world_has_mann_and_whitney_s_test() -> None:
    """The p and the kind of `rank_test`, and the effect size is the same in other words."""
    x, y = [1.0, 5.0, 6.0, 7.0, 9.0], [2.0, 2.0, 3.0, 4.0]
    test, improvement = rank_test(x, y), improvement_test([x], [y])
    assert (improvement.p, improvement.kind) == (test.p, test.kind)
    assert probability_of_improvement([x], [y]) == pytest.approx((1 - test.r) / 2)


def test_worlds_of_different_sizes_are_approximated() -> None:
    """The kind states it; p is near the exact one of as many runs everywhere."""
    exact, pairs = improvement_test(A, B), improvement_test(A, B, paired=True)
    assert (exact.kind, pairs.kind) == (EXACT, EXACT_PAIRS)
    fewer = improvement_test([A[0][:9], *A[1:]], B)
    assert fewer.kind == NORMAL
    assert fewer.p == pytest.approx(exact.p, abs=0.002)
    approximated = improvement_test(
        [x[:9] if k else x for k, x in enumerate(A)],
        [x[:9] if k else x for k, x in enumerate(B)],
        paired=True,
    )
    assert approximated.kind == NORMAL
    assert approximated.p == pytest.approx(pairs.p, abs=0.003)


@pytest.mark.slow
def test_exact_p_values_are_uniform_without_a_difference() -> None:
    """Of 400 comparisons of equal arms about 5 % have p < 0.05, stratified and paired."""
    rng = np.random.default_rng(0)
    for paired in (False, True):
        p = [
            improvement_test(rng.normal(size=(3, 6)), rng.normal(size=(3, 6)), paired=paired).p
            for _ in range(400)
        ]
        assert 0.02 <= np.mean(np.array(p) < 0.05) <= 0.08


@pytest.mark.slow
@pytest.mark.parametrize(
    ("worlds", "runs", "least", "most"),
    [(1, 10, 0.87, 0.97), (2, 5, 0.86, 0.96), (5, 5, 0.86, 0.96), (5, 3, 0.80, 0.88)],
)
def test_coverage_of_intervals_of_scores_with_two_peaks(
    worlds: int, runs: int, least: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With few runs a world they cover too little, which is why these have none."""
    monkeypatch.setattr("studies.comparison.aggregates.MIN_PER_WORLD", 3)
    monkeypatch.setattr("studies.comparison.aggregates.RESAMPLES", 1000)
    rng = np.random.default_rng(1)

    def sample(*shape: int) -> Any:
        return (rng.random(shape) < 0.5) + rng.normal(0, 0.1, shape)

    expected = {statistic: statistic(sample(2_000_000)) for statistic in (mean, interquartile_mean)}
    trials = [sample(worlds, runs) for _ in range(800)]
    for statistic, value in expected.items():
        intervals = [stratified_bootstrap(each, statistic) for each in trials]
        assert least <= np.mean([i.low <= value <= i.high for i in intervals]) <= most


@pytest.mark.parametrize(
    ("strata", "message"),
    [
        ([], "Expected scores of at least one world, found none"),
        ([[]], r"Expected 1 to 10,000 scores of an arm in a world, found an array of shape \(0,\)"),
        ([[[1.0, 2.0]]], r"found an array of shape \(1, 2\); give one number a run"),
        ([[1.0, nan, 2.0]], r"Expected finite scores of at most 1e\+100, found nan; a run that"),
        ([[1.0, float("inf")], [2.0]], "Expected finite scores of at most .*, found inf"),
        ([[1.0, None]], "found nan"),
        ([[-1e308] * 12], r"found -1e\+308, -1e\+308, -1e\+308, \.\.\.;"),
        ([["good"]], "Expected scores as lists of numbers, found others"),
        ([[1.0, [2.0]]], "Expected scores as lists of numbers, found others"),
        ([5.0], r"found an array of shape \(\)"),
        ([np.zeros(MAX_SCORES + 1)], r"shape \(10001,\)"),
    ],
)
def test_what_are_no_scores_is_refused(strata: list[list[float]], message: str) -> None:
    """By every function, with what was expected, what was found, and the remedy."""
    for ask in (
        lambda: stratified_bootstrap(strata, mean),
        lambda: performance_profile(strata, [0.0]),
        lambda: probability_of_improvement(strata, strata),
        lambda: improvement_interval(strata, strata),
        lambda: improvement_test(strata, strata),
    ):
        with pytest.raises(StudyError, match=message):
            ask()


def test_arms_that_do_not_fit_are_refused() -> None:
    """Other worlds, or pairs that are not as many; thresholds that are none or too many."""
    with pytest.raises(StudyError, match="in the same worlds, found 1 worlds and 2"):
        probability_of_improvement([[1.0]], [[1.0], [2.0]])
    for ask in (improvement_interval, improvement_test):
        with pytest.raises(StudyError, match=r"as many scores of both arms.*found 2 and 1"):
            ask([[1.0, 2.0]], [[1.0]], paired=True)
    for at in ([], [nan], np.arange(MAX_THRESHOLDS + 1.0)):
        with pytest.raises(StudyError, match="Expected 1 to 400 finite thresholds"):
            performance_profile([[1.0]], at)
