"""CMA-ES of a vector of numbers (Hansen 2016, arXiv 1604.00772), by the package `cmaes`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from islandgp.scoring.constraints import Merit

MAX_EQUAL: Final = 20  # generations of equal merits after which a search has converged

Numbers: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]


class Cma:
    """The distribution of CMA-ES, which follows from the arguments and what it was told."""

    def __init__(
        self, mean: Numbers, sigma: float, *, size: int, seed: int, bounds: Numbers | None = None
    ) -> None:
        """The first distribution.

        Args:
            mean: of the distribution.
            sigma: its standard deviation in each dimension, > 0.
            size: samples of a generation, >= 2.
            seed: of the samples.
            bounds: lowest and highest value of each dimension.
        """
        from cmaes import CMA  # type: ignore[import-untyped] # it ships no types; it loads SciPy

        self._optimizer = CMA(mean, sigma, bounds, seed=seed, population_size=size)
        self._equal = 0  # generations, the last ones, of equal merits

    @property
    def mean(self) -> Numbers:
        """The mean of the distribution."""
        mean: Numbers = self._optimizer.mean
        return mean

    @property
    def generation(self) -> int:
        """Number of updates."""
        return int(self._optimizer.generation)

    @property
    def converged(self) -> bool:
        """True if more samples would hardly differ, or MAX_EQUAL generations did not."""
        return self._equal >= MAX_EQUAL or bool(self._optimizer.should_stop())

    def ask(self) -> list[Numbers]:
        """The samples of a generation; each call draws new ones."""
        return [self._optimizer.ask() for _ in range(self._optimizer.population_size)]

    def tell(self, samples: Sequence[Numbers], merits: Sequence[Merit]) -> None:
        """Update the distribution by the ranks of all samples; equal merits teach nothing."""
        ranked = sorted(merits, reverse=True)
        if ranked[0] != ranked[-1]:
            pairs = zip(samples, merits, strict=True)
            self._equal = 0
            self._optimizer.tell([(sample, float(ranked.index(merit))) for sample, merit in pairs])
        else:
            self._equal += 1
