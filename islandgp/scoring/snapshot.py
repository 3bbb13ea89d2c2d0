"""One generation in numbers, and the behaviours that individuals are told apart by."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, pstdev
from typing import Final

from islandgp.scoring.classify import (
    Classes,
    Specialist,
    Tier,
    is_charging,
    is_clearing,
    specialist,
    tiers,
)
from islandgp.scoring.diversity import diversity, working_ratio
from islandgp.scoring.outcome import Outcome

BEHAVIOURS: Final = ("pickup", "humanoid", "balanced", "charging", "clearing")
"""What behavioural elites, resurrection and Table 7 care for: classes and labels."""


def behaviours(o: Outcome, classes: Classes) -> tuple[str, ...]:
    """Which of BEHAVIOURS an individual shows."""
    label = specialist(o, classes)
    shown = (label is not Specialist.PATROL_ONLY, is_charging(o), is_clearing(o))
    names = (label.value, "charging", "clearing")
    return tuple(name for name, yes in zip(names, shown, strict=True) if yes)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One generation in numbers."""

    generation: int  # from 0
    epoch: int  # from 1
    stage: int  # index into Table 2, from 0
    best: float  # highest fitness, points
    mean: float  # mean fitness, points
    sd: float  # its standard deviation over the population, points
    diversity: float  # Eq. (3)
    working: float  # Eq. (4)
    specialists: dict[str, int]  # individuals by exclusive class
    # Individuals with a pickup, humanoid interaction, delivery, charge in any episode. The latter
    # two are those that carry the labels clearing and charging (section 2.3.3).
    doing: dict[str, int]
    tiers: dict[str, int]  # individuals by tier of Table 4
    distance: float  # m, mean
    inactive: float  # s since the last non-movement action, mean
    size: float  # nodes, mean
    rate: float  # mutation rate that made this generation


def measure(
    outcomes: Sequence[Outcome],
    sizes: Sequence[int],
    classes: Classes,
    *,
    generation: int,
    epoch: int,
    stage: int,
    rate: float,
) -> Snapshot:
    """The snapshot of an evaluated population."""
    labels = [specialist(o, classes) for o in outcomes]
    reached = Counter(tier for o in outcomes for tier in tiers(o, classes))
    fitness = [o.fitness for o in outcomes]
    counts = Counter(labels)
    return Snapshot(
        generation=generation,
        epoch=epoch,
        stage=stage,
        best=max(fitness),
        mean=fmean(fitness),
        sd=pstdev(fitness),
        diversity=diversity(labels),
        working=working_ratio(outcomes),
        specialists={c.value: counts[c] for c in Specialist},
        doing={
            "pickup": sum(o.pickups > 0 for o in outcomes),
            "humanoid": sum(o.interactions > 0 for o in outcomes),
            "clearing": sum(map(is_clearing, outcomes)),
            "charging": sum(map(is_charging, outcomes)),
        },
        tiers={t.value: reached[t] for t in Tier},
        distance=fmean(o.distance for o in outcomes),
        inactive=fmean(o.inactive for o in outcomes),
        size=fmean(sizes),
        rate=rate,
    )
