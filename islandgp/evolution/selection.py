"""Who becomes a parent: tournaments, with niche protection (section 2.3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from islandgp.evolution.population import Evaluated
from islandgp.scoring.classify import Specialist


def tournament(
    rng: np.random.Generator, population: Sequence[Evaluated], entrants: int
) -> Evaluated:
    """The fittest of `entrants` >= 1 individuals drawn with replacement; the first of equals."""
    drawn = [population[int(i)] for i in rng.integers(len(population), size=entrants)]
    return max(drawn, key=lambda e: e.fitness)


def pick_parent(
    rng: np.random.Generator,
    population: Sequence[Evaluated],
    supplied: Counter[str],
    *,
    most: float,
    entrants: int,
) -> Evaluated:
    """A tournament's winner, with niche protection.

    A class that has given `most` parents sits out as long as another class of
    working robots has room: then the tournament is held among those.
    """
    first = tournament(rng, population, entrants)
    if supplied[first.specialist] < most:
        return first
    others = [
        e
        for e in population
        if supplied[e.specialist] < most and e.specialist is not Specialist.PATROL_ONLY
    ]
    return tournament(rng, others, entrants) if others else first
