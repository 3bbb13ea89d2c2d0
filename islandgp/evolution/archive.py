"""The best ever of each behaviour: resurrected when a behaviour has died out (section 2.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from islandgp.bt.node import Node
from islandgp.evolution.population import Evaluated
from islandgp.scoring.snapshot import BEHAVIOURS


@dataclass(frozen=True, slots=True)
class Ancestor:
    """The best individual of a behaviour that has ever been."""

    id: str  # of the individual
    tree: Node
    fitness: float  # points


Archive = Mapping[str, Ancestor]  # by behaviour


def remember(archive: Archive, population: Sequence[Evaluated]) -> dict[str, Ancestor]:
    """The archive with this generation's best of each behaviour, where they are better."""
    kept = dict(archive)
    for e in population:
        for behaviour in e.behaviours:
            if behaviour not in kept or e.fitness > kept[behaviour].fitness:
                kept[behaviour] = Ancestor(e.individual.id, e.individual.tree, e.fitness)
    return {name: kept[name] for name in BEHAVIOURS if name in kept}
