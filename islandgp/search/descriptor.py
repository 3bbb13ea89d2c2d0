"""Behaviour descriptors: vectors of counters for MAP-Elites and novelty search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import ceil, copysign, log2

from islandgp.domain import Outcome, Schema
from islandgp.domain.rewards import unknown
from islandgp.scoring.classes import Classes
from islandgp.search.breeding import BreedingSettings


class DescriptorSettings(BreedingSettings, frozen=True):
    """Settings of a search with a descriptor."""

    descriptor: tuple[str, ...]  # counters; (): those of the behaviours

    def faults(self, schema: Schema) -> Iterator[str]:
        """See `Search`: a line for each counter that is not declared, or that occurs twice."""
        for k, counter in enumerate(self.descriptor):
            yield from unknown(f"search.policy.descriptor.{k}", counter, schema.counters)
        yield from repeated("search.policy.descriptor", self.descriptor)

    def counters(self, classes: Classes) -> tuple[str, ...]:
        """The counters of the descriptor."""
        return self.descriptor or tuple(dict.fromkeys(classes.behaviours.values()))


def repeated(path: str, names: Sequence[str]) -> Iterator[str]:
    """A line if a name occurs twice."""
    if twice := next((name for name in names if names.count(name) > 1), None):
        yield f"{path}: expected each name once, found {twice!r} twice"


def point(counters: Sequence[str], outcome: Outcome) -> tuple[float, ...]:
    """The descriptor of an outcome: by counter a value on a scale where each bin has the width 1.

    Each bin is twice as wide as the one before it; 0 stays 0.
    """
    values = [outcome.counters[name] for name in counters]
    return tuple([copysign(log2(1 + abs(value)), value) for value in values])


@lru_cache(maxsize=4096)  # a grid asks for the cell of each tree in each generation
def cell(descriptor: tuple[float, ...], bins: int) -> tuple[int, ...]:
    """The cell of a descriptor: bin 0 has the value 0 only, and the bins end at +-`bins`."""
    return tuple([int(copysign(min(bins, ceil(abs(x))), x)) if x else 0 for x in descriptor])
