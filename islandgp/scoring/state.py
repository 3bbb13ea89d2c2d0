"""The state of the population that a supervisor receives: Table 5, section 2.4.5.

The state is a function of the statistics of the generations so far, so it can be recomputed from a
run's history. `Crisis` is the emergency override of Eq. (7) and (8), section 2.4.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from pydantic import BaseModel, Field

from islandgp.domain import total
from islandgp.scoring.generation_stats import GenerationStats


class Crisis(BaseModel, frozen=True, extra="forbid"):
    """Conditions of a crisis, and the mutation rate that is then enforced."""

    diversity_below: float = Field(ge=0, le=1)  # Eq. (7): threshold of Eq. (3)
    stagnant_epochs_above: float = Field(ge=0)  # Eq. (7): epochs without a rise of the best
    emergency_rate: float = Field(ge=0, le=1)  # Eq. (8)

    def reason(self, diversity: float, stagnant_epochs: float) -> str:
        """Eq. (7): "diversity" or "stagnation", or "" without a crisis."""
        if diversity < self.diversity_below:
            return "diversity"
        return "stagnation" if stagnant_epochs > self.stagnant_epochs_above else ""

    def rate(self, proposed: float, reason: str) -> float:
        """Eq. (8): the emergency rate in a crisis, else the rate that the supervisor advised."""
        return self.emergency_rate if reason else proposed


class StateSettings(BaseModel, frozen=True, extra="forbid"):
    """Settings of trends and plateaus."""

    window: int = Field(ge=2, le=50)  # generations of a trend
    improvement: float = Field(ge=0, le=1)  # least relative rise of the best that counts
    low_diversity: float = Field(ge=0, le=1)  # below it there is a warning, not yet a crisis


@dataclass(frozen=True, slots=True)
class PopulationState:
    """Table 5: the input of a supervisor's guidance.

    Fitness is compared within a stage of the curriculum only, as stages have different scales. At
    the start of a stage its changes, trends and plateau are 0.
    """

    now: GenerationStats
    history: tuple[GenerationStats, ...]  # the last generations, oldest first, `now` included
    best_rose: bool  # the best of the stage rose in the last generation
    best_rise: float  # relative rise of the best over the window
    best_change: float  # points, against the previous generation
    mean_change: float  # points
    best_trend: float  # points per generation, least squares over the window
    mean_trend: float  # points per generation
    diversity_change: float  # against the previous generation
    diversity_trend: float  # per generation
    stagnant_generations: int  # since the best of the stage last rose
    stagnant_epochs: float  # the same in epochs
    crisis: str  # Eq. (7): "diversity", "stagnation", or "" for none
    diversity_warning: bool  # diversity is low
    milestones_reached: dict[str, bool]  # by milestone, the easiest first
    dominant: str  # the largest exclusive class
    rarest_behaviours: tuple[str, ...]  # by number of individuals, the rarest first
    targets: tuple[str, ...]  # targets of trees (Table 7)
    mutation_rate: float  # in force
    crossover_rate: float
    population: int
    generations: int  # of the whole run
    multipliers: dict[str, float]  # of the next generation's stage

    @property
    def quality_count(self) -> int:
        """Number of individuals that reach the first milestone."""
        return self.now.tiers[next(iter(self.milestones_reached))]

    @property
    def ever_quality(self) -> bool:
        """True if an individual has ever reached the first milestone."""
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
        if snapshot.stage != stage or snapshot.fitness_max > best + improvement * abs(best):
            stage, best, since = snapshot.stage, snapshot.fitness_max, 0
    return since
