"""Aggregates of scores: IQM, performance profiles, probability of improvement.

The formulas are those of Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep
reinforcement learning at the edge of the statistical precipice" (NeurIPS 2021), and of their
library rliable 1.2.0. An arm's scores come world by world ("strata"); intervals are
percentiles of a bootstrap that resamples the runs within each world. Where arms share seeds,
both runs of a seed are resampled together.

Values are sorted before resampling, with a random stream per purpose, so the order of the runs has
no effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import erfc, nan, sqrt
from typing import Any, Final

import numpy as np

from islandgp.errors import StudyError
from islandgp.seeding import Stream, stream
from islandgp.statistics import (
    ENUMERATED,
    EXACT,
    UNTESTED,
    Interval,
    doubled_ranks,
    rank_test,
    sums_of_splits,
    sums_of_subsets,
    two_sided,
)
from studies.comparison.strata import Strata, arrays_of, first_values, in_worlds
from studies.resampling import MIN_VALUES, RESAMPLES

EXACT_PAIRS: Final = "exact, exchanges of the pairs enumerated"
NORMAL: Final = "asymptotic, corrected for ties"
MIN_PER_WORLD: Final = 5  # least runs per world; with 3 in each of 5, intervals cover 83 to 86 %
MAX_THRESHOLDS: Final = 400  # most thresholds of a profile
BLOCK: Final = 1_000_000  # numbers drawn at a time
MAX_SUM: Final = 100_000  # largest sum for an exact test


@dataclass(frozen=True, slots=True)
class Profile:
    """Share of an arm's runs with a score above each threshold, with its 95 % band."""

    thresholds: tuple[float, ...]  # strictly rising
    share: tuple[float, ...]  # in [0, 1], not rising
    low: tuple[float, ...]  # pointwise; nan: too few runs
    high: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ImprovementTest:
    """Two-sided test that the probability of improvement differs from one half."""

    p: float
    kind: str  # EXACT, EXACT_PAIRS, NORMAL, or a kind of `rank_test`


def mean(scores: Any) -> Any:
    """The mean over the last axis."""
    return np.mean(scores, axis=-1)


def median(scores: Any) -> Any:
    """The median over the last axis."""
    return np.median(scores, axis=-1)


def interquartile_mean(scores: Any) -> Any:
    """The mean of the middle half over the last axis (IQM).

    The floor(n/4) lowest and highest scores are left out, as by
    `scipy.stats.trim_mean(scores, 0.25)`. So up to three scores are all averaged.
    """
    ordered = np.sort(np.asarray(scores, float), axis=-1)
    n = ordered.shape[-1]
    return ordered[..., n // 4 : n - n // 4].mean(axis=-1)


def probability_of_improvement(first: Strata, second: Strata) -> float:
    """The probability that a run of the first arm scores higher than one of the second.

    In a world it is Mann-Whitney's U / (n1 n2), with ties counted half; in terms of the effect size
    r of `rank_test` it is (1 - r) / 2. Over worlds it is the mean, so worlds need no common scale.

    Args:
        first: scores of the first arm, world by world; any number in each.
        second: scores of the second one, in the same worlds.

    Raises:
        StudyError: scores are missing or not finite, or the arms have different numbers of worlds.
    """
    worlds = in_worlds(first, second)
    return float(np.mean([_wins(x, y) / (len(x) * len(y)) for x, y in worlds]))


def _wins(x: Any, y: Any) -> float:
    """U of the first sample; values that are equal to DECIMALS decimals count half."""
    below = np.searchsorted(y, x, side="left")
    equal = np.searchsorted(y, x, side="right") - below
    return float(np.sum(below) + np.sum(equal) / 2)


def stratified_bootstrap(strata: Strata, statistic: Callable[[Any], Any]) -> Interval:
    """A statistic of all scores of an arm with its 95 % percentile interval.

    A resample has as many scores of each world as the arm. The interval is nan for fewer than
    MIN_VALUES scores, and for several worlds if one has fewer than MIN_PER_WORLD, as it would cover
    too little.

    Args:
        strata: the scores, world by world. A world with more runs weighs more, and all worlds
            must have one scale.
        statistic: reduces the last axis, as `mean`, `median` and `interquartile_mean` do.

    Raises:
        StudyError: scores are missing or not finite.
    """
    arrays = [np.sort(each) for each in arrays_of(strata)]
    estimate = float(statistic(np.concatenate(arrays)))
    if not _enough(arrays):
        return Interval(estimate, nan, nan)
    sizes = [len(each) for each in arrays]
    samples = [
        statistic(np.concatenate([a[i] for a, i in zip(arrays, places, strict=True)], axis=-1))
        for places in _resamples(sizes, sum(sizes))
    ]
    return _with_ends(estimate, np.concatenate(samples))


def improvement_interval(first: Strata, second: Strata, *, paired: bool = False) -> Interval:
    """The probability of improvement with its 95 % percentile interval.

    Both arms are resampled, world by world. The interval is nan if `stratified_bootstrap` has none
    for one of the arms.

    Args:
        first: scores of the first arm, world by world.
        second: scores of the second one, in the same worlds.
        paired: scores at one place are of one seed; they are drawn together.

    Raises:
        StudyError: as `probability_of_improvement`, or pairs are not as many in both arms.
    """
    worlds = in_worlds(first, second, paired=paired)
    estimate = probability_of_improvement(first, second)
    if not all(_enough(arm) for arm in zip(*worlds, strict=True)):
        return Interval(estimate, nan, nan)
    sizes = [[len(sample) for sample in arm] for arm in zip(*worlds, strict=True)]
    block = sum(map(sum, sizes))
    first_samples = _resamples(sizes[0], block)
    second_samples = first_samples if paired else _resamples(sizes[1], block, sample=1)
    codes = [_codes(x, y) for x, y in worlds]
    estimates = []
    for places in first_samples:
        others = places if paired else next(second_samples)
        each = [_improvement(*c, i, j) for c, i, j in zip(codes, places, others, strict=True)]
        estimates.append(np.mean(each, axis=0))
    return _with_ends(estimate, np.concatenate(estimates))


def _codes(x: Any, y: Any) -> tuple[Any, Any, int]:
    """The values of both samples as indices of the distinct values, and the number of these."""
    values, codes = np.unique(np.concatenate([x, y]), return_inverse=True)
    return codes[: len(x)], codes[len(x) :], len(values)


def _improvement(x: Any, y: Any, different: int, places: Any, others: Any) -> Any:
    """U / (n1 n2) of each resample, from the counts of its values."""
    first_counts, second_counts = _counts(x[places], different), _counts(y[others], different)
    below = np.cumsum(second_counts, axis=1) - second_counts
    return np.sum(first_counts * (below + second_counts / 2), axis=1) / (len(x) * len(y))


def _counts(codes: Any, different: int) -> Any:
    """The number of occurrences of each code below `different` in each row."""
    rows = np.arange(len(codes))[:, None] * different
    return np.bincount((codes + rows).ravel(), minlength=len(codes) * different).reshape(
        len(codes), different
    )


def performance_profile(strata: Strata, thresholds: Sequence[float]) -> Profile:
    """The share of an arm's runs with a score above each threshold, with a 95 % band.

    The band is pointwise, by the bootstrap of `stratified_bootstrap`.

    Args:
        strata: the scores, world by world; all worlds must have one scale.
        thresholds: at least one and at most MAX_THRESHOLDS, finite; their order does not matter.

    Raises:
        StudyError: scores or thresholds are missing or not finite, or thresholds are too many.
    """
    steps = np.unique(np.asarray(thresholds, float))
    if not 0 < len(steps) <= MAX_THRESHOLDS or not np.all(np.isfinite(steps)):
        raise StudyError(
            f"Expected 1 to {MAX_THRESHOLDS} finite thresholds of a performance profile, found"
            f" {len(steps)}, {first_values(steps)}; `thresholds` chooses some."
        )
    arrays = [np.sort(each) for each in arrays_of(strata)]
    exceeded = [np.searchsorted(steps, each, side="left") for each in arrays]  # steps below each
    n = sum(map(len, arrays))

    def shares(codes: Any) -> Any:
        return (n - np.cumsum(_counts(codes, len(steps) + 1), axis=1)[:, :-1]) / n

    share = shares(np.concatenate(exceeded)[None, :])[0]
    low = high = np.full(len(steps), nan)
    if _enough(arrays):
        profiles = [
            shares(np.concatenate([e[i] for e, i in zip(exceeded, places, strict=True)], axis=1))
            for places in _resamples([len(each) for each in arrays], max(n, len(steps)))
        ]
        low, high = np.quantile(np.concatenate(profiles), (0.025, 0.975), axis=0)
    steps_, share_, low_, high_ = (tuple(map(float, row)) for row in (steps, share, low, high))
    return Profile(steps_, share_, low_, high_)


def thresholds(*arms: Strata) -> tuple[float, ...]:
    """The thresholds at which the profiles of some arms change: all distinct scores.

    If there are more than MAX_THRESHOLDS, that many evenly spaced values.
    """
    values = np.unique(np.concatenate([each for strata in arms for each in arrays_of(strata)]))
    if len(values) > MAX_THRESHOLDS:
        values = np.linspace(values[0], values[-1], MAX_THRESHOLDS)
    return tuple(map(float, values))


def improvement_test(first: Strata, second: Strata, *, paired: bool = False) -> ImprovementTest:
    """The two-sided test of the probability of improvement.

    For a single world it is Mann-Whitney's; for several it is that test stratified by world: a
    permutation test over all splits of the runs of each world. For pairs, the two runs of a seed
    are exchanged instead. If worlds have different numbers of runs, or very many, the distribution
    is approximated by a normal one.

    Args:
        first: scores of the first arm, world by world.
        second: scores of the second one, in the same worlds.
        paired: scores at one place are of one seed.

    Raises:
        StudyError: as `improvement_interval`.
    """
    worlds = in_worlds(first, second, paired=paired)
    if len(worlds) == 1 and not paired:
        test = rank_test(*worlds[0])
        return ImprovementTest(test.p, test.kind)
    strata = [_exchanged(x, y) if paired else _split(x, y) for x, y in worlds]
    if not any(s.variance > 0 for s in strata):
        return ImprovementTest(1.0, UNTESTED)
    alike = len({(len(x), len(y)) for x, y in worlds}) == 1
    few = all((len(x) if paired else len(x) + len(y)) <= ENUMERATED for x, y in worlds)
    if alike and few and sum(s.most for s in strata) <= MAX_SUM:
        ways = np.ones(1)
        for s in strata:
            counted = s.counts()
            ways = np.convolve(ways, counted / counted.sum())
        kind = EXACT_PAIRS if paired else EXACT
        return ImprovementTest(two_sided(ways, sum(s.observed for s in strata)), kind)
    distance = sum((s.observed - s.centre) / s.scale for s in strata)
    deviation = sqrt(sum(s.variance / s.scale**2 for s in strata))
    return ImprovementTest(erfc(abs(distance) / deviation / sqrt(2)), NORMAL)


@dataclass(frozen=True, slots=True)
class _Stratum:
    """The statistic of a world, a whole number from 0, and its distribution under the null.

    It is twice U, up to a constant that is the same for all splits or exchanges.
    """

    observed: int
    most: int
    centre: float  # its mean
    variance: float
    scale: float  # the statistic is the probability of improvement times this, plus a constant
    counts: Callable[[], Any]  # the frequency of each value


def _split(x: Any, y: Any) -> _Stratum:
    n1, n2 = len(x), len(y)
    ranks = doubled_ranks(np.concatenate([x, y]))
    least = n1 * (n1 + 1)
    return _Stratum(
        observed=int(ranks[:n1].sum()) - least,
        most=2 * n1 * n2,
        centre=n1 * n2,
        variance=n1 * n2 / max(n1 + n2 - 1, 1) * float(np.var(ranks)),
        scale=2 * n1 * n2,
        counts=lambda: sums_of_splits(ranks, n1)[least : least + 2 * n1 * n2 + 1],
    )


def _exchanged(x: Any, y: Any) -> _Stratum:
    n = len(x)
    ranks = doubled_ranks(np.concatenate([x, y]))
    gains = ranks[:n] - ranks[n:]
    weights = np.abs(gains)
    return _Stratum(
        observed=int(gains[gains > 0].sum()),
        most=int(weights.sum()),
        centre=float(weights.sum() / 2),
        variance=float(np.sum(weights.astype(float) ** 2) / 4),
        scale=2 * n * n,
        counts=lambda: sums_of_subsets(weights),
    )


def _resamples(sizes: Sequence[int], width: int, *, sample: int = 0) -> Iterator[list[Any]]:
    """The indices of RESAMPLES resamples, world by world, in blocks.

    `width` is the number of values that the caller stores per resample; a block has BLOCK values.
    """
    draws = [
        stream(0, Stream.RESAMPLING, generation=sample, slot=world) for world in range(len(sizes))
    ]
    rows = max(1, BLOCK // width)
    for start in range(0, RESAMPLES, rows):
        number = min(rows, RESAMPLES - start)
        yield [rng.integers(n, size=(number, n)) for rng, n in zip(draws, sizes, strict=True)]


def _with_ends(estimate: float, ends: Any) -> Interval:
    low, high = np.quantile(ends, (0.025, 0.975))
    return Interval(estimate, float(low), float(high))


def _enough(samples: Sequence[Any]) -> bool:
    """True if an arm has enough runs for an interval."""
    sizes = [len(each) for each in samples]
    return sum(sizes) >= MIN_VALUES and (len(sizes) == 1 or min(sizes) >= MIN_PER_WORLD)
