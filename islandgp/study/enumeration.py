"""Exact p-values for tied samples: every way to share out the ranks is counted.

The shift algorithm of Streitberg and Roehmel, "Exact distributions for permutation
and rank tests", Statistical Software Newsletter 12 (1986) 10-17: a value enters
as its mid-rank, doubled so that it is a whole number, and shifts the counts of
all sums that were reached without it. Sixty values take some milliseconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def tied_rank_p(first: Any, second: Any) -> float:
    """Two-sided p of Mann-Whitney's U over all splits of the values into two such samples.

    Twice the smaller tail, at most 1, as scipy has it. Both are arrays of numbers.
    """
    ranks = _doubled_ranks(np.concatenate([first, second]))
    n = len(first)
    ways = np.zeros((n + 1, int(ranks.sum()) + 1))  # values taken x sum of their ranks
    ways[0, 0] = 1
    for rank in ranks:
        ways[1:, rank:] += ways[:-1, : ways.shape[1] - rank].copy()
    return _two_sided(ways[n], int(ranks[:n].sum()))


def tied_signed_rank_p(differences: Any) -> float:
    """Two-sided p of Wilcoxon's signed-rank test over all signs of the differences, none of 0."""
    ranks = _doubled_ranks(np.abs(differences))
    ways = np.zeros(int(ranks.sum()) + 1)  # by the sum of the positive ranks
    ways[0] = 1
    for rank in ranks:
        ways[rank:] += ways[: len(ways) - rank].copy()
    return _two_sided(ways, int(ranks[differences > 0].sum()))


def _doubled_ranks(values: Any) -> Any:
    """Mid-ranks from 1, times two."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    return (2 * last - counts + 1)[place]


def _two_sided(ways: Any, found: int) -> float:
    tail = min(ways[: found + 1].sum(), ways[found:].sum())
    return min(1.0, float(2 * tail / ways.sum()))
