"""The population's state that a supervisor sees: Table 5 and the list of section 2.4.5.

A `GenerationStats` is one generation in numbers. The state is a function of the
generations so far, so that it can be made again from a run's history.

The emergency override in a crisis is that of Eq. (7) and (8), section 2.4.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from pydantic import BaseModel, Field

from islandgp.domain import total
from islandgp.scoring.classes import Classes
from islandgp.scoring.generation_stats import GenerationStats


class Crisis(BaseModel, frozen=True, extra="forbid"):
    """Conditions of a crisis, and the mutation rate that is then enforced."""

    diversity_below: float = Field(ge=0, le=1)  # Eq. (7): threshold of Eq. (3)
    stagnant_epochs_above: float = Field(ge=0)  # Eq. (7): epochs without a better best
    emergency_rate: float = Field(ge=0, le=1)  # Eq. (8)

    def reason(self, diversity: float, stagnant_epochs: float) -> str:
        """Eq. (7): "diversity" or "stagnation", or "" when there is no crisis."""
        if diversity < self.diversity_below:
            return "diversity"
        return "stagnation" if stagnant_epochs > self.stagnant_epochs_above else ""

    def rate(self, wanted: float, reason: str) -> float:
        """Eq. (8): the emergency rate in a crisis, else what the supervisor wanted."""
        return self.emergency_rate if reason else wanted


class StateSettings(BaseModel, frozen=True, extra="forbid"):
    """Windows for trends and plateaus of the history."""

    window: int = Field(ge=2, le=50)  # generations that a trend looks back
    improvement: float = Field(ge=0, le=1)  # share by which a best must rise to count as better
    low_diversity: float = Field(ge=0, le=1)  # a warning, not yet a crisis


@dataclass(frozen=True, slots=True)
class PopulationState:
    """Table 5. Everything a supervisor may base its guidance on.

    Fitness is compared within a stage of the curriculum alone: other multipliers,
    another scale. When a stage begins its changes, trends and plateau begin at 0.
    """

    now: GenerationStats
    history: tuple[GenerationStats, ...]  # the last generations, oldest first, `now` included
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
    milestones_reached: dict[str, bool]  # by milestone, the easiest first
    dominant: str  # the largest exclusive class
    rarest_behaviours: tuple[str, ...]  # behaviours by rising number of individuals that do them
    targets: tuple[str, ...]  # what a tree can be for (Table 7)
    mutation_rate: float  # now in force
    crossover_rate: float
    population: int
    generations: int  # of the whole run
    multipliers: dict[str, float]  # of the next generation's stage

    @property
    def quality(self) -> int:
        """Robots of the first milestone that are alive now."""
        return self.now.tiers[next(iter(self.milestones_reached))]

    @property
    def ever_quality(self) -> bool:
        """True if a robot of the first milestone has existed."""
        return next(iter(self.milestones_reached.values()))


def trend(values: Sequence[float]) -> float:
    """Slope of the least-squares line through values at 0, 1, 2, ...; 0 for a single one."""
    n = len(values)
    if n < 2:
        return 0.0
    centre, mean = (n - 1) / 2, fmean(values)
    top = total((i - centre) * (v - mean) for i, v in enumerate(values))
    return top / total((i - centre) ** 2 for i in range(n))


def stagnant(history: Sequence[GenerationStats], improvement: float) -> int:
    """Generations since the best of the present stage last rose by more than `improvement`."""
    stage, best, since = -1, 0.0, 0
    for snapshot in history:
        since += 1
        if snapshot.stage != stage or snapshot.best > best + improvement * abs(best):
            stage, best, since = snapshot.stage, snapshot.best, 0
    return since


def population_state(
    history: Sequence[GenerationStats],
    settings: StateSettings,
    crisis: Crisis,
    classes: Classes,
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
    plateau, counts = stagnant(history, settings.improvement), now.behaviour_counts
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
        milestones_reached={
            name: any(s.tiers[name] for s in history) for name in classes.milestones
        },
        dominant=max(now.specialists, key=lambda name: now.specialists[name]),
        rarest_behaviours=tuple(sorted(counts, key=lambda name: counts[name])),
        targets=classes.targets,
        mutation_rate=now.rate,
        crossover_rate=crossover_rate,
        population=population,
        generations=generations,
        multipliers=multipliers,
    )
