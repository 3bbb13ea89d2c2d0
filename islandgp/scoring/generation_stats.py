"""Statistics of a generation: diversity, Eq. (3), the working ratio, Eq. (4), and counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GenerationStats:
    """Statistics of a generation."""

    generation: int  # from 0
    epoch: int  # from 1
    stage: int  # index into Table 2, from 0
    fitness_max: float  # fitness of the best individual, points
    fitness_mean: float  # mean fitness, points
    fitness_sd: float  # its standard deviation over the population, points
    diversity: float  # Eq. (3), over the exclusive classes
    overlapping: float  # Eq. (3), over the behaviours, of which an individual may show several
    working: float  # Eq. (4)
    specialists: dict[str, int]  # individuals by exclusive class
    behaviour_counts: dict[str, int]  # individuals by behaviour shown in any episode
    tiers: dict[str, int]  # individuals by tier of Table 4
    counters: dict[str, float]  # means over the population, by counter of the domain
    size: float  # nodes, mean
    rate: float  # mutation rate with which this generation was created


def diversity(specialists: Sequence[str]) -> float:
    """Eq. (3): D = 1 - max_c n_c / N, below 1; 0 when all are of one class."""
    return 1 - max(Counter(specialists).values()) / len(specialists)


def overlapping(behaviour_counts: Mapping[str, int]) -> float:
    """Eq. (3) for overlapping categories: D = 1 - max_b n_b / sum_b n_b; 0 if all counts are 0.

    Only with this reading are the numbers of Table 12 consistent with those of Table 13.
    """
    total = sum(behaviour_counts.values())
    return 1 - max(behaviour_counts.values()) / total if total else 0.0
