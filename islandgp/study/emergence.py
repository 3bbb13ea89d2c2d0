"""Emergence of a tier (section 3.4, Table 11), with censored runs.

A run in which the tier does not emerge is censored at its last generation; it is neither dropped
nor given a substitute value. In the rank test its rank is after the last generation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, sqrt

from islandgp.statistics import mean_sd
from islandgp.study.arms import Run


def first(run: Run, tier: str) -> int | None:
    """The first generation, from 0, with an individual of a tier; None: never."""
    return next((s.generation for s in run.snapshots if s.tiers[tier]), None)


def ranks(firsts: Sequence[float | None], generations: int) -> list[float]:
    """Values for a rank test; a censored run ranks after the last generation."""
    return [float(generations if g is None else g) for g in firsts]


@dataclass(frozen=True, slots=True)
class EmergenceSummary:
    """One arm's times to emergence."""

    runs: int
    emerged: int  # number of runs in which the tier emerged
    mean: float | None  # generation; None when a run is censored
    sd: float | None  # sample standard deviation; None when a run is censored, nan for one run
    median: float | None  # generation; None if half of the runs or more are censored
    watched: float  # restricted mean: generations without the tier, mean over all runs

    @property
    def never(self) -> bool:
        """True if the tier emerged in no run; then `watched` is the length of the runs."""
        return self.emerged == 0


def summary(firsts: Sequence[float | None], generations: int) -> EmergenceSummary:
    """The summary of an arm's times to emergence.

    `watched` is the restricted mean of survival analysis: a censored run counts with its number of
    generations.
    """
    reached = sorted(g for g in firsts if g is not None)
    n, all_reached = len(firsts), len(reached) == len(firsts)
    mean, sd = mean_sd(reached) if all_reached else (None, None)
    return EmergenceSummary(
        runs=n,
        emerged=len(reached),
        mean=mean,
        sd=sd,
        median=quantile(firsts, 0.5),
        watched=sum(ranks(firsts, generations)) / n,
    )


def quantile(firsts: Sequence[float | None], share: float) -> float | None:
    """A quantile over all runs, by linear interpolation; None if it is among censored runs."""
    reached = sorted(g for g in firsts if g is not None)
    at = share * (len(firsts) - 1)
    low, high = floor(at), ceil(at)
    if high >= len(reached):
        return None
    return reached[low] + (at - low) * (reached[high] - reached[low])


def still_without(firsts: Sequence[int | None], generations: int) -> list[float]:
    """Share of runs without the tier up to and including each generation (Kaplan-Meier)."""
    n = len(firsts)
    return [sum(f is None or f > g for f in firsts) / n for g in range(generations)]


def band(share: float, n: int) -> tuple[float, float]:
    """95 % interval of a share of n runs (Wilson)."""
    z = 1.959964
    middle, wide = share + z * z / (2 * n), z * sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return (middle - wide) / (1 + z * z / n), (middle + wide) / (1 + z * z / n)


def reduction(
    first_arm: EmergenceSummary, second_arm: EmergenceSummary
) -> tuple[float, str] | None:
    """The relative reduction of the time to emergence in the first arm, and the compared statistic.

    The statistic is the mean if no run is censored, as in the paper; else the median; else the
    restricted mean. None if no comparison is possible.
    """
    if not first_arm.emerged and not second_arm.emerged:
        return None
    for name, a, b in (
        ("means", first_arm.mean, second_arm.mean),
        ("medians", first_arm.median, second_arm.median),
        ("generations without one", first_arm.watched, second_arm.watched),
    ):
        if a is not None and b:
            return 1 - a / b, name
    return None
