"""Selection of parents: tournaments with niche protection (section 2.3)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

from islandgp.gp.population import Evaluated
from islandgp.plugin import function
from islandgp.seeding import Rng

T = TypeVar("T")


def tournament(rng: Rng, population: Sequence[Evaluated], entrants: int) -> Evaluated:
    """The best of `entrants` >= 1 individuals drawn with replacement; the first of equals."""
    drawn = [population[int(i)] for i in rng.integers(len(population), size=entrants)]
    return max(drawn, key=lambda e: e.merit)


def by_rank(rng: Rng, ranked: Sequence[T], entrants: int = 2) -> T:
    """The first in `ranked` of `entrants` >= 1 items drawn with replacement."""
    return ranked[int(rng.integers(len(ranked), size=entrants).min())]


def halved(n: int, fewest: int) -> int:
    """The number of candidates that stay after a round of successive halving."""
    return max(fewest, (n + 1) // 2)


Selection = Callable[[Rng, Sequence[Evaluated], int], Evaluated]

SELECTIONS: Final[dict[str, Selection]] = {"tournament": tournament}
"""Ways to choose a parent. A new one is a function and an entry."""


def selection(name: str) -> Selection:
    """The selection of this name or path. It raises PartError if it returns no individual."""
    return function(name, SELECTIONS, _must_be_individual)


def _must_be_individual(result: object, *_: object) -> None:
    if not isinstance(result, Evaluated):
        raise TypeError(
            f"expected it to return an individual (Evaluated), found {type(result).__name__}"
        )


def pick_parent(
    rng: Rng,
    select: Selection,
    population: Sequence[Evaluated],
    supplied: Counter[str],
    *,
    most: float,
    entrants: int,
) -> Evaluated:
    """A selected individual, with niche protection.

    A class with `most` parents is excluded as long as another class of working robots has fewer.
    """
    first = select(rng, population, entrants)
    if supplied[first.labels.specialist] < most:
        return first
    others = [e for e in population if supplied[e.labels.specialist] < most and e.labels.working]
    return select(rng, others, entrants) if others else first
