"""The control without inheritance: each individual is a new random tree.

The trees are those that the other searches begin with, and none is evaluated twice. So the
difference of a search to this control is the effect of selection and variation. Random search is
the usual baseline of genetic programming, e.g. in Langdon and Poli 2002, Foundations of Genetic
Programming. `search=random_paper` draws the paper's random trees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from islandgp.gp.evidence import digest
from islandgp.gp.population import Evaluated
from islandgp.search.base import SearchState
from islandgp.search.breeding import MAX_DIGESTS, BreedingSearch, GenerationPlan, RandomTrees


class RandomSearchSettings(RandomTrees, frozen=True, extra="forbid"):
    """Settings of the random trees."""

    reads: ClassVar = ("gp.trees",)

    @property
    def breeding(self) -> RandomTrees:
        """The settings of new trees, which have no parents."""
        return self


@dataclass(frozen=True, slots=True)
class RandomMemory:
    """The trees evaluated so far."""

    tried: tuple[str, ...] = ()  # digests


class RandomSearch(BreedingSearch[RandomSearchSettings]):
    """Evaluates new random trees in each generation."""

    Settings = RandomSearchSettings
    Memory: ClassVar[Any] = RandomMemory
    uses: ClassVar[frozenset[str]] = frozenset()

    def plan_next(self, state: SearchState) -> GenerationPlan:
        """See `BreedingSearch`."""
        return GenerationPlan(known_digests=state.memory.tried)

    def update(self, state: SearchState, evaluated: Sequence[Evaluated]) -> RandomMemory:
        """See `BreedingSearch`. Fitness has no effect."""
        before = () if state.memory is None else state.memory.tried
        tried = dict.fromkeys((*before, *(digest(e.individual.tree) for e in evaluated)))
        return RandomMemory(tuple(tried)[-MAX_DIGESTS:])
