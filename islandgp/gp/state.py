"""The statistics of a generation and the state of the population, lines 5 and 6 of Algorithm 1."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import fmean, pstdev

from islandgp.bt.core.node import size
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated
from islandgp.scoring.generation_stats import GenerationStats, diversity, overlapping
from islandgp.scoring.state import PopulationState, stagnant, trend


def generation_stats(
    plan: Plan, generation: int, rate: float, population: Sequence[Evaluated]
) -> GenerationStats:
    """The statistics of an evaluated generation that was created with the mutation rate `rate`."""
    classes, outcomes = plan.classes, [e.outcome for e in population]
    specialists = [e.labels.specialist for e in population]
    tiers = Counter([tier for e in population for tier in e.labels.tiers])
    fitness = [o.fitness for o in outcomes]
    counts = Counter(specialists)
    individuals = Counter([name for o in outcomes for name in classes.behaviours_of(o.counters)])
    behaviours = {name: individuals[name] for name in classes.behaviours}
    return GenerationStats(
        generation=generation,
        epoch=plan.curriculum.epoch(generation),
        stage=plan.curriculum.stage(generation),
        fitness_max=max(e.merit for e in population)[1],
        fitness_mean=fmean(fitness),
        fitness_sd=pstdev(fitness),
        diversity=diversity(specialists),
        overlapping=overlapping(behaviours),
        working=sum(e.labels.working for e in population) / len(population),
        specialists={name: counts[name] for name in classes.specialist_names},
        behaviour_counts=behaviours,
        tiers={name: tiers[name] for name in classes.tiers},
        counters={
            name: fmean([o.counters[name] for o in outcomes]) for name in outcomes[0].counters
        },
        size=fmean([size(e.individual.tree) for e in population]),
        rate=rate,
    )


def population_state(plan: Plan, history: Sequence[GenerationStats]) -> PopulationState:
    """The state (Table 5) after a history: all generations so far, oldest first."""
    settings, per_epoch = plan.gp.state, plan.curriculum.generations_per_epoch
    now, recent = history[-1], tuple(history[-settings.window :])
    before = history[-2] if len(history) > 1 else now
    stage = [s for s in recent if s.stage == now.stage]
    last = stage[-2] if len(stage) > 1 else now
    plateau, counts = stagnant(history, settings.improvement), now.behaviour_counts
    following = plan.curriculum.stage(now.generation + 1)
    return PopulationState(
        now=now,
        history=recent,
        best_rose=plateau == 0 and len(stage) > 1,
        best_rise=(now.fitness_max - stage[0].fitness_max) / max(1.0, abs(stage[0].fitness_max)),
        best_change=now.fitness_max - last.fitness_max,
        mean_change=now.fitness_mean - last.fitness_mean,
        best_trend=trend([s.fitness_max for s in stage]),
        mean_trend=trend([s.fitness_mean for s in stage]),
        diversity_change=now.diversity - before.diversity,
        diversity_trend=trend([s.diversity for s in recent]),
        stagnant_generations=plateau,
        stagnant_epochs=plateau / per_epoch,
        crisis=plan.gp.crisis.reason(now.diversity, plateau / per_epoch),
        diversity_warning=now.diversity < settings.low_diversity,
        milestones_reached={
            name: any(s.tiers[name] for s in history) for name in plan.classes.milestones
        },
        dominant=max(now.specialists, key=lambda name: now.specialists[name]),
        rarest_behaviours=tuple(sorted(counts, key=lambda name: counts[name])),
        targets=plan.classes.targets,
        mutation_rate=now.rate,
        crossover_rate=plan.gp.crossover_rate,
        population=plan.gp.population,
        generations=plan.gp.generations,
        multipliers=dict(plan.curriculum.multipliers(following)),
    )
