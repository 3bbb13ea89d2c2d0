"""The population's state that a supervisor sees: Table 5 and the list of section 2.4.5.

A `Snapshot` is what one generation measured. The state is a function of the
snapshots so far, so that it can be made again from a run's history.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, pstdev
from typing import Final

from pydantic import BaseModel, Field

from islandgp.scoring.classify import (
    Classes,
    Specialist,
    Tier,
    is_charging,
    is_clearing,
    specialist,
    tiers,
)
from islandgp.scoring.crisis import Crisis
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


class StateSettings(BaseModel, frozen=True, extra="forbid"):
    """How trends and plateaus are read from the history."""

    window: int = Field(ge=2, le=50)  # generations that a trend looks back
    improvement: float = Field(ge=0, le=1)  # share by which a best must rise to count as better
    low_diversity: float = Field(ge=0, le=1)  # a warning, not yet a crisis


@dataclass(frozen=True, slots=True)
class PopulationState:
    """Table 5. Everything a supervisor may base its guidance on.

    Fitness is compared within a stage of the curriculum alone: other multipliers,
    another scale. When a stage begins its changes, trends and plateau begin at 0.
    """

    now: Snapshot
    history: tuple[Snapshot, ...]  # the last generations, oldest first, `now` included
    best_rose: bool  # the best of the present stage has just risen
    best_rise: float  # rise of the best over the window, as a share of what it was
    best_change: float  # points: best now minus the best of the previous generation
    mean_change: float  # points
    best_trend: float  # points a generation, least squares over the window
    mean_trend: float  # points a generation
    diversity_change: float  # against the previous generation
    diversity_trend: float  # a generation
    stagnant_generations: int  # since the best of the present stage last rose
    stagnant_epochs: float  # the same in epochs
    crisis: str  # Eq. (7): "diversity", "stagnation", or "" when there is none
    diversity_warning: bool  # diversity is low
    ever_complete: bool  # a Complete Robot has existed
    ever_excellent: bool  # an Excellent Robot has existed
    dominant: str  # the largest exclusive class
    lacking: tuple[str, ...]  # behaviours by rising number of individuals that do them
    mutation_rate: float  # now in force
    crossover_rate: float
    population: int
    generations: int  # of the whole run
    multipliers: dict[str, float]  # of the next generation's stage


def trend(values: Sequence[float]) -> float:
    """Slope of the least-squares line through values at 0, 1, 2, ...; 0 for a single one."""
    n = len(values)
    if n < 2:
        return 0.0
    centre, mean = (n - 1) / 2, fmean(values)
    top = sum((i - centre) * (v - mean) for i, v in enumerate(values))
    return top / sum((i - centre) ** 2 for i in range(n))


def stagnant(history: Sequence[Snapshot], improvement: float) -> int:
    """Generations since the best of the present stage last rose by more than `improvement`."""
    stage, best, since = -1, 0.0, 0
    for snapshot in history:
        since += 1
        if snapshot.stage != stage or snapshot.best > best + improvement * abs(best):
            stage, best, since = snapshot.stage, snapshot.best, 0
    return since


def population_state(
    history: Sequence[Snapshot],
    settings: StateSettings,
    crisis: Crisis,
    *,
    crossover_rate: float,
    population: int,
    generations: int,
    generations_per_epoch: int,
    multipliers: dict[str, float],
) -> PopulationState:
    """The state after the last generation of `history` (all generations so far, oldest first)."""
    now, recent = history[-1], tuple(history[-settings.window :])
    before = history[-2] if len(history) > 1 else now
    stage = [s for s in recent if s.stage == now.stage]
    last = stage[-2] if len(stage) > 1 else now
    plateau = stagnant(history, settings.improvement)
    return PopulationState(
        now=now,
        history=recent,
        best_rose=plateau == 0 and len(stage) > 1,
        best_rise=(now.best - stage[0].best) / max(1.0, abs(stage[0].best)),
        best_change=now.best - last.best,
        mean_change=now.mean - last.mean,
        best_trend=trend([s.best for s in stage]),
        mean_trend=trend([s.mean for s in stage]),
        diversity_change=now.diversity - before.diversity,
        diversity_trend=trend([s.diversity for s in recent]),
        stagnant_generations=plateau,
        stagnant_epochs=plateau / generations_per_epoch,
        crisis=crisis.reason(now.diversity, plateau / generations_per_epoch),
        diversity_warning=now.diversity < settings.low_diversity,
        ever_complete=any(s.tiers[Tier.COMPLETE] for s in history),
        ever_excellent=any(s.tiers[Tier.EXCELLENT] for s in history),
        dominant=max(now.specialists, key=lambda name: now.specialists[name]),
        lacking=tuple(sorted(now.doing, key=lambda name: now.doing[name])),
        mutation_rate=now.rate,
        crossover_rate=crossover_rate,
        population=population,
        generations=generations,
        multipliers=multipliers,
    )
