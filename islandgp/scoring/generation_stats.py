"""Statistics of a generation: diversity, Eq. (3), the working ratio, Eq. (4), and counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, pstdev

from islandgp.domain import Outcome
from islandgp.scoring.classes import BehaviourLabels, Classes
from islandgp.scoring.constraints import NO_CONSTRAINTS, Constraints, merit, violation
from islandgp.scoring.curriculum import Curriculum


@dataclass(frozen=True, slots=True)
class GenerationStats:
    """Statistics of a generation."""

    generation: int  # from 0
    epoch: int  # from 1
    stage: int  # index into Table 2, from 0
    fitness_max: float  # fitness of the best individual, points
    fitness_mean: float  # mean fitness, points
    fitness_sd: float  # its standard deviation over the population, points
    diversity: float  # Eq. (3), over the exclusive classes
    overlapping: float  # Eq. (3), over the behaviours, of which an individual may show several
    working: float  # Eq. (4)
    specialists: dict[str, int]  # individuals by exclusive class
    behaviour_counts: dict[str, int]  # individuals by behaviour shown in any episode
    tiers: dict[str, int]  # individuals by tier of Table 4
    counters: dict[str, float]  # means over the population, by counter of the domain
    size: float  # nodes, mean
    rate: float  # mutation rate with which this generation was created


def diversity(specialists: Sequence[str]) -> float:
    """Eq. (3): D = 1 - max_c n_c / N, below 1; 0 when all are of one class."""
    return 1 - max(Counter(specialists).values()) / len(specialists)


def overlapping(behaviour_counts: Mapping[str, int]) -> float:
    """Eq. (3) for overlapping categories: D = 1 - max_b n_b / sum_b n_b; 0 if all counts are 0.

    Only with this reading are the numbers of Table 12 consistent with those of Table 13.
    """
    total = sum(behaviour_counts.values())
    return 1 - max(behaviour_counts.values()) / total if total else 0.0


def generation_stats(
    outcomes: Sequence[Outcome],
    labels: Sequence[BehaviourLabels],
    sizes: Sequence[int],
    classes: Classes,
    curriculum: Curriculum,
    *,
    generation: int,
    rate: float,
    constraints: Constraints = NO_CONSTRAINTS,
) -> GenerationStats:
    """Line 5 of Algorithm 1: the statistics of an evaluated population, created with `rate`."""
    specialists = [label.specialist for label in labels]
    tier_counts = Counter([tier for label in labels for tier in label.tiers])
    fitness = [o.fitness for o in outcomes]
    merits = [
        merit(points, violation(o.counters, constraints))
        for points, o in zip(fitness, outcomes, strict=True)
    ]
    counts = Counter(specialists)
    individuals = Counter([name for o in outcomes for name in classes.behaviours_of(o.counters)])
    behaviours = {name: individuals[name] for name in classes.behaviours}
    return GenerationStats(
        generation=generation,
        epoch=curriculum.epoch(generation),
        stage=curriculum.stage(generation),
        fitness_max=max(merits)[1],
        fitness_mean=fmean(fitness),
        fitness_sd=pstdev(fitness),
        diversity=diversity(specialists),
        overlapping=overlapping(behaviours),
        working=sum(label.working for label in labels) / len(labels),
        specialists={name: counts[name] for name in classes.specialist_names},
        behaviour_counts=behaviours,
        tiers={name: tier_counts[name] for name in classes.tiers},
        counters={
            name: fmean([o.counters[name] for o in outcomes]) for name in outcomes[0].counters
        },
        size=fmean(sizes),
        rate=rate,
    )
