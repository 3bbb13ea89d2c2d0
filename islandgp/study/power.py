"""What a number of seeds can show: the smallest difference that a test finds 4 times in 5."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

LEVEL: Final = 0.05  # section 3.1: alpha
POWER: Final = 0.8
SIMULATIONS: Final = 4_000  # pairs of samples a step: the power is known to about +-0.013
SEED: Final = 7
LARGEST: Final = 8.0  # SDs; beyond it the arms cannot be told apart by more distance


@dataclass(frozen=True, slots=True)
class Power:
    """The smallest difference that n1 and n2 runs show with 80 % at a level."""

    n: tuple[int, int]
    level: float  # of a single test
    shift: float | None  # in standard deviations, for normal values; None: no difference is enough
    superiority: float | None  # the chance that a run of the better arm beats one of the other
    r: float | None  # the effect size that belongs to it, in size
    least_p: float  # the smallest p that the exact test can give


@cache
def smallest_difference(n1: int, n2: int, level: float = LEVEL) -> Power:
    """By simulation of the exact Mann-Whitney test on shifted normal samples, seeded."""
    from scipy import stats  # type: ignore[import-untyped] # scipy ships no types

    least = float(stats.mannwhitneyu(np.arange(n1), np.arange(n2) + n1, method="exact").pvalue)
    if least > level:
        return Power((n1, n2), level, None, None, None, least)
    rng = np.random.default_rng(SEED)
    x, y = rng.normal(size=(SIMULATIONS, n1)), rng.normal(size=(SIMULATIONS, n2))
    low, high = 0.0, LARGEST
    while high - low > 0.005:
        middle = (low + high) / 2
        if _power(stats, x, y + middle, level) < POWER:
            low = middle
        else:
            high = middle
    superiority = float(stats.norm.cdf(high / np.sqrt(2)))
    return Power((n1, n2), level, high, superiority, 2 * superiority - 1, least)


def _power(stats: Any, x: Any, y: Any, level: float) -> float:
    return float(np.mean(stats.mannwhitneyu(x, y, axis=1, method="exact").pvalue <= level))
