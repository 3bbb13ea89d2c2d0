"""Individuals before and after evaluation, and their origins."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from pydantic import PlainSerializer, PlainValidator, ValidationInfo

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.domain import Outcome
from islandgp.scoring.classes import BehaviourLabels
from islandgp.scoring.constraints import Merit, merit


def _parsed(text: str, info: ValidationInfo) -> Node:
    return parse(text, info.context)


Tree = Annotated[Node, PlainValidator(_parsed), PlainSerializer(to_text)]
"""A tree; serialised as its canonical text. It is parsed with the vocabulary in the context of
`from_json`, without which the words of keys are not known."""


class Origin(StrEnum):
    """Origin of an individual (Table 1)."""

    RANDOM = "random"  # generation 0, and diversity slots
    CROSSOVER = "crossover"  # child of two parents, or of one and a tree of the library
    COPY = "copy"  # child of one parent
    ELITE = "elite"
    BEHAVIOURAL_ELITE = "behavioural_elite"
    RESURRECTED = "resurrected"
    INJECTED = "injected"  # the supervisor's tree, or one of the library in generation 0
    SAMPLED = "sampled"  # from the distribution of a search
    EDITED = "edited"  # tree of an earlier individual with an edit of the supervisor


@dataclass(frozen=True, slots=True)
class Proposal:
    """A tree for a population, not yet in a slot."""

    tree: Tree
    origin: Origin
    parents: tuple[str, ...] = ()  # ids
    mutation: str = ""  # mutation operators, joined by "+", or ""; "edit:<kind>"


@dataclass(frozen=True, slots=True)
class Individual:
    """A tree in a population, not yet evaluated."""

    id: str  # "<generation>.<slot>"
    tree: Tree
    origin: Origin
    parents: tuple[str, ...] = ()  # ids
    mutation: str = ""  # mutation operator, or ""


@dataclass(frozen=True, slots=True)
class Advice:
    """The checked guidance of a supervisor for one generation."""

    rate: float  # mutation rate in force, in [0, 1]
    tree: Tree | None = None  # to inject, within the limits
    edited: tuple[Proposal, ...] = ()
    """Edited trees, within the limits, to evaluate in slots of their own; at most
    `supervisor.edits`, which is at most `gp.population` - 3."""


def in_slots(proposals: Iterable[Proposal], generation: int) -> Iterator[Individual]:
    """The individuals of a generation, each as soon as it is proposed."""
    for slot, each in enumerate(proposals):
        name = f"{generation}.{slot}"
        yield Individual(name, each.tree, each.origin, each.parents, each.mutation)


@dataclass(frozen=True, slots=True)
class Evaluated:
    """An individual with its outcome."""

    individual: Individual
    outcome: Outcome
    labels: BehaviourLabels
    fitness: float  # points, Eq. (1), of the outcome
    episodes: tuple[float, ...] = ()  # points in each episode
    violation: float = 0.0  # of the constraints, >= 0; 0: it keeps all of them

    @property
    def merit(self) -> Merit:
        """Sort key: fewer constraint violations first, then fitness."""
        return merit(self.fitness, self.violation)


def ranked(population: tuple[Evaluated, ...]) -> list[Evaluated]:
    """The individuals sorted by merit, best first; equal ones in slot order."""
    return sorted(population, key=lambda e: e.merit, reverse=True)
