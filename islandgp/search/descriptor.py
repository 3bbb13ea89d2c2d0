"""Behaviour descriptors: vectors of counters for MAP-Elites and novelty search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, copysign, isfinite, log2
from typing import Annotated, Final

from pydantic import AfterValidator

from islandgp.domain import Outcome, Schema
from islandgp.domain.rewards import unknown
from islandgp.scoring.classes import Classes
from islandgp.search.breeding import BreedingSettings

MAX_BINS: Final = 1e30  # greater values are clipped


@dataclass(frozen=True, slots=True)
class Dimension:
    """A counter and its scale."""

    counter: str
    width: float | None  # of a bin, > 0; None: each bin is twice as wide as the one before it

    def scaled(self, value: float) -> float:
        """A counter's value on a scale where each bin has the width 1; 0 stays 0."""
        if self.width is not None:
            return copysign(min(abs(value) / self.width, MAX_BINS), value)
        return copysign(log2(1 + abs(value)), value)


def dimension(text: str) -> Dimension:
    """Reads "COUNTER" or "COUNTER/WIDTH". Raises ValueError."""
    counter, slash, number = text.partition("/")
    try:
        width = float(number) if slash else None
    except ValueError:
        width = 0.0
    if not counter or (width is not None and not (isfinite(width) and width > 0)):
        raise ValueError(f"expected COUNTER, or COUNTER/WIDTH with a width above 0, found {text!r}")
    return Dimension(counter, width)


def _readable(text: str) -> str:
    dimension(text)
    return text


Descriptor = tuple[Annotated[str, AfterValidator(_readable)], ...]
"""Settings of a descriptor; empty: the counters of the behaviours."""


def dimensions(texts: Sequence[str], classes: Classes) -> tuple[Dimension, ...]:
    """The dimensions of a configured descriptor; by default the behaviours' counters."""
    return tuple(dimension(text) for text in texts or dict.fromkeys(classes.behaviours.values()))


class DescriptorSettings(BreedingSettings, frozen=True):
    """Settings of a search with a descriptor."""

    descriptor: Descriptor
    """COUNTER, or COUNTER/WIDTH for bins of equal width on a linear scale. Empty: the counters of
    the behaviours."""

    def faults(self, schema: Schema) -> Iterator[str]:
        """See `Search`: a line for each counter that is not declared, or that occurs twice."""
        counters = [dimension(text).counter for text in self.descriptor]
        for k, counter in enumerate(counters):
            yield from unknown(f"search.policy.descriptor.{k}", counter, schema.counters)
        yield from repeated("search.policy.descriptor", counters)


def repeated(path: str, names: Sequence[str]) -> Iterator[str]:
    """A line if a name occurs twice."""
    if twice := next((name for name in names if names.count(name) > 1), None):
        yield f"{path}: expected each name once, found {twice!r} twice"


def point(dimensions: Sequence[Dimension], outcome: Outcome) -> tuple[float, ...]:
    """The descriptor of an outcome: a scaled value for each dimension."""
    return tuple([d.scaled(outcome.counters[d.counter]) for d in dimensions])


@lru_cache(maxsize=4096)  # a grid asks for the cell of each tree in each generation
def cell(descriptor: tuple[float, ...], bins: int) -> tuple[int, ...]:
    """The cell of a descriptor: bin 0 has the value 0 only, and the bins end at +-`bins`."""
    return tuple([int(copysign(min(bins, ceil(abs(x))), x)) if x else 0 for x in descriptor])
