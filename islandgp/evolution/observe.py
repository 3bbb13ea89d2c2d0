"""Lines 5 and 6 of Algorithm 1: a generation in numbers, and the state that supervisors see."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.bt.node import size
from islandgp.evolution.plan import Plan
from islandgp.evolution.population import Evaluated
from islandgp.scoring.snapshot import Snapshot, measure
from islandgp.scoring.state import PopulationState, population_state


def snapshot(plan: Plan, generation: int, population: Sequence[Evaluated], rate: float) -> Snapshot:
    """Line 5: a generation in numbers; `rate` is the mutation rate that made it."""
    return measure(
        [e.outcome for e in population],
        [size(e.individual.tree) for e in population],
        plan.classes,
        generation=generation,
        epoch=plan.curriculum.epoch(generation),
        stage=plan.curriculum.stage(generation),
        rate=rate,
    )


def view(plan: Plan, history: Sequence[Snapshot]) -> PopulationState:
    """Line 6: Table 5, after the last generation of `history`."""
    stage = plan.curriculum.stage(history[-1].generation + 1)
    return population_state(
        history,
        plan.gp.state,
        plan.gp.crisis,
        crossover_rate=plan.gp.crossover_rate,
        population=plan.gp.population,
        generations=plan.gp.generations,
        generations_per_epoch=plan.curriculum.generations_per_epoch,
        multipliers=plan.curriculum.multipliers(stage).model_dump(),
    )
