"""Emergence of a tier (section 3.4, Table 11), with censored runs.

A run without one is censored at its last generation. It is neither left out nor given a made-up
value. For the rank test it ranks after the last generation, which is all that ranks need.
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
    """Values for a rank test: a run without one comes after the last generation."""
    return [float(generations if g is None else g) for g in firsts]


@dataclass(frozen=True, slots=True)
class EmergenceSummary:
    """One arm's times to emergence."""

    runs: int
    emerged: int  # runs in which it happened
    mean: float | None  # generation; None when a run is censored
    sd: float | None  # sample standard deviation; None when a run is censored, nan for one run
    median: float | None  # generation; None when half the runs or more never got there
    watched: float  # generations lived through without one, mean over all runs

    @property
    def never(self) -> bool:
        """True if the tier emerged in no run; then `watched` is the length of the runs."""
        return self.emerged == 0


def summary(firsts: Sequence[float | None], generations: int) -> EmergenceSummary:
    """The figures that hold with censored runs, and those that hold only without.

    `watched` is the restricted mean of survival analysis: a censored run counts
    with the generations that it was really watched.
    """
    reached = sorted(g for g in firsts if g is not None)
    n, whole = len(firsts), len(reached) == len(firsts)
    mean, sd = mean_sd(reached) if whole else (None, None)
    return EmergenceSummary(
        runs=n,
        emerged=len(reached),
        mean=mean,
        sd=sd,
        median=quantile(firsts, 0.5),
        watched=sum(ranks(firsts, generations)) / n,
    )


def quantile(firsts: Sequence[float | None], share: float) -> float | None:
    """Of all runs, linear between two of them; None: it falls among those without one."""
    reached = sorted(g for g in firsts if g is not None)
    at = share * (len(firsts) - 1)
    low, high = floor(at), ceil(at)
    if high >= len(reached):
        return None
    return reached[low] + (at - low) * (reached[high] - reached[low])


def still_without(firsts: Sequence[int | None], generations: int) -> list[float]:
    """Share of the runs without one up to and including each generation (Kaplan-Meier)."""
    n = len(firsts)
    return [sum(f is None or f > g for f in firsts) / n for g in range(generations)]


def band(share: float, n: int) -> tuple[float, float]:
    """95 % interval of a share of n runs (Wilson): all are watched to the last generation."""
    z = 1.959964
    middle, wide = share + z * z / (2 * n), z * sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return (middle - wide) / (1 + z * z / n), (middle + wide) / (1 + z * z / n)


def reduction(
    first_arm: EmergenceSummary, second_arm: EmergenceSummary
) -> tuple[float, str] | None:
    """By which share the first arm is earlier, and what was compared; None: nothing can be.

    Means when every run got there, as in the paper; else medians; else the
    generations watched without one.
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
