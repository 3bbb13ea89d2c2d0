"""Sample outcomes, statistics and states of the island; tests change single values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any, Final

import yaml

from islandgp.bt.core.language import parse
from islandgp.domain import Outcome
from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.evolution.validation import Best, Validation
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated, Individual, Origin
from islandgp.gp.record import Champion
from islandgp.gp.state import population_state
from islandgp.resources import resource
from islandgp.scoring.classes import Classes, classify
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.scoring.state import PopulationState
from tests.composed import composed_plan

_PAPER = resource("conf") / "classes" / "paper.yaml"
CLASSES: Final = Classes(**yaml.safe_load(_PAPER.read_text(encoding="utf-8")))
"""The behaviours, classes and tiers of the paper."""


def best_of(champion: Champion, validation: Validation | None = None) -> Best:
    """A best robot that was not shortened."""
    record = champion.record
    return Best(champion.generation, record, record.tree, record.tree, validation)


ANY: Final = "patrol"  # component that holds a fitness whose terms do not matter

NOTHING: Final = Outcome(
    components=dict.fromkeys(SCHEMA.components, 0.0),
    counters={**dict.fromkeys(SCHEMA.counters, 0.0), "battery": 50.0},
    seconds=420.0,
    endings=("time",),
)

QUIET: Final = GenerationStats(
    generation=0,
    epoch=1,
    stage=0,
    fitness_max=1000.0,
    fitness_mean=100.0,
    fitness_sd=50.0,
    diversity=0.6,
    overlapping=0.75,
    working=0.5,
    specialists={"patrol_only": 12, "pickup": 10, "humanoid": 4, "balanced": 4},
    behaviour_counts={"pickup": 10, "humanoid": 10, "charging": 10, "clearing": 10},
    tiers={"excellent": 0, "complete": 0, "full_service": 0, "balanced_elite": 0},
    counters={**NOTHING.counters, "distance": 500.0, "inactive": 30.0},
    size=12.0,
    rate=0.4,
)

EARLY: Final = {"garbage": 2.0, "battery": 1.0, "humanoid": 1.5, "delivery": 1.0, "leftover": 0.8}
"""Table 2's multipliers in epochs 1 and 2."""


def outcome(
    fitness: float | None = None,
    *,
    components: dict[str, float] | None = None,
    seconds: float = NOTHING.seconds,
    endings: tuple[str, ...] = NOTHING.endings,
    **counters: float,
) -> Outcome:
    """The outcome of a robot that did nothing, with these changes.

    Args:
        fitness: points of the component `ANY`.
        components: points by component, instead of `fitness`.
        seconds, endings: fields of the outcome.
        counters: by name.
    """
    assert counters.keys() <= SCHEMA.counters.keys(), counters
    points = components or {ANY: fitness or 0.0}
    return Outcome(
        components={**NOTHING.components, **points},
        counters={**NOTHING.counters, **{name: float(n) for name, n in counters.items()}},
        seconds=seconds,
        endings=endings,
    )


def snapshot(
    generation: int = 0,
    *,
    behaviour_counts: dict[str, int] | None = None,
    complete: int = 0,
    excellent: int = 0,
    counters: dict[str, float] | None = None,
    **changes: Any,
) -> GenerationStats:
    """Statistics of a generation that has every behaviour and no Complete robot."""
    return replace(
        QUIET,
        generation=generation,
        behaviour_counts={**QUIET.behaviour_counts, **(behaviour_counts or {})},
        tiers={**QUIET.tiers, "complete": complete, "excellent": excellent},
        counters={**QUIET.counters, **(counters or {})},
        **changes,
    )


@cache
def paper_plan() -> Plan:
    """The plan of the paper's experiment."""
    return composed_plan("experiment=paper")


def state(history: Sequence[GenerationStats], **changes: Any) -> PopulationState:
    """The state after a history, with the paper's settings."""
    return replace(population_state(paper_plan(), history), **{"multipliers": EARLY, **changes})


def evaluated(
    name: str, result: Outcome, classes: Classes = CLASSES, tree: str = "PatrolWaypoint"
) -> Evaluated:
    """An individual with an outcome, classified."""
    individual = Individual(name, parse(tree), Origin.RANDOM)
    return Evaluated(individual, result, classify(result, classes), result.fitness)
