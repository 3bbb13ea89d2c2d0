"""Outcomes, snapshots and states with plain values, of which a test changes what it is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from islandgp.bt.language import parse
from islandgp.evolution.population import Evaluated, Individual, Origin
from islandgp.scoring.classify import Classes, specialist, tiers
from islandgp.scoring.crisis import Crisis
from islandgp.scoring.outcome import Outcome
from islandgp.scoring.snapshot import Snapshot, behaviours
from islandgp.scoring.state import PopulationState, StateSettings, population_state

NOTHING = Outcome(
    fitness=0.0,
    components=(0.0,) * 8,
    pickups=0.0,
    interactions=0.0,
    deliveries=0.0,
    charges=0.0,
    gathered=0.0,
    delivered=0.0,
    collisions=0.0,
    distance=0.0,
    inactive=0.0,
    laps=0.0,
    battery=50.0,
    seconds=420.0,
    endings=("time",),
)

QUIET = Snapshot(
    generation=0,
    epoch=1,
    stage=0,
    best=1000.0,
    mean=100.0,
    sd=50.0,
    diversity=0.6,
    working=0.5,
    specialists={"patrol_only": 12, "pickup": 10, "humanoid": 4, "balanced": 4},
    doing={"pickup": 10, "humanoid": 10, "clearing": 10, "charging": 10},
    tiers={"excellent": 0, "complete": 0, "full_service": 0, "balanced_elite": 0},
    distance=500.0,
    inactive=30.0,
    size=12.0,
    rate=0.4,
)


EARLY = {"garbage": 2.0, "battery": 1.0, "humanoid": 1.5, "delivery": 1.0, "leftover": 0.8}
"""Table 2's multipliers in epochs 1 and 2."""


def outcome(**changes: Any) -> Outcome:
    """A robot that did nothing, but for the changes."""
    return replace(NOTHING, **changes)


def snapshot(
    generation: int = 0,
    *,
    doing: dict[str, int] | None = None,
    complete: int = 0,
    excellent: int = 0,
    **changes: Any,
) -> Snapshot:
    """A generation in which everything is done by somebody and nobody is Complete."""
    return replace(
        QUIET,
        generation=generation,
        doing={**QUIET.doing, **(doing or {})},
        tiers={**QUIET.tiers, "complete": complete, "excellent": excellent},
        **changes,
    )


def state(history: Sequence[Snapshot], **changes: Any) -> PopulationState:
    """The state after a history, as a run with the paper's numbers sees it."""
    found = population_state(
        history,
        StateSettings(window=5, improvement=0.01, low_diversity=0.3),
        Crisis(diversity_below=0.05, stagnant_epochs_above=1.5, emergency_rate=0.5),
        crossover_rate=0.8,
        population=30,
        generations=41,
        generations_per_epoch=5,
        multipliers=EARLY,
    )
    return replace(found, **changes)


def evaluated(
    name: str, done: Outcome, classes: Classes, tree: str = "PatrolWaypoint"
) -> Evaluated:
    """An individual with an outcome, classified."""
    return Evaluated(
        Individual(name, parse(tree), Origin.RANDOM),
        done,
        specialist(done, classes),
        tiers(done, classes),
        behaviours(done, classes),
    )
