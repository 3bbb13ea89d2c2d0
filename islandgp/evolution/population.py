"""The nouns of evolution: individuals before and after evaluation, and where they come from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from islandgp.bt.node import Node
from islandgp.scoring.classify import Specialist, Tier
from islandgp.scoring.outcome import Outcome


class Origin(StrEnum):
    """How an individual came into its population (Table 1)."""

    RANDOM = "random"  # generation 0, and diversity slots
    CROSSOVER = "crossover"  # tournament child of two parents
    COPY = "copy"  # tournament child of one parent
    ELITE = "elite"
    BEHAVIOURAL_ELITE = "behavioural_elite"
    RESURRECTED = "resurrected"
    INJECTED = "injected"  # the supervisor's tree


@dataclass(frozen=True, slots=True)
class Individual:
    """A tree in a population, not yet evaluated."""

    id: str  # "<generation>.<slot>"
    tree: Node
    origin: Origin
    parents: tuple[str, ...] = ()  # ids
    mutation: str = ""  # the operator that changed it after construction, or ""


@dataclass(frozen=True, slots=True)
class Evaluated:
    """An individual with what it achieved."""

    individual: Individual
    outcome: Outcome
    specialist: Specialist
    tiers: tuple[Tier, ...]
    behaviours: tuple[str, ...]  # those of scoring.state.BEHAVIOURS that it shows

    @property
    def fitness(self) -> float:
        """Points, Eq. (1)."""
        return self.outcome.fitness


def ranked(population: tuple[Evaluated, ...]) -> list[Evaluated]:
    """Best first; equals in slot order."""
    return sorted(population, key=lambda e: -e.fitness)
