"""Lines 4 to 6 of Algorithm 1: episodes, a generation in numbers, and what supervisors see."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.bt.node import size
from islandgp.domain import Outcome, total
from islandgp.evaluation.base import Evaluator, Job
from islandgp.evolution.plan import Plan
from islandgp.evolution.population import Evaluated, Individual
from islandgp.scoring.classes import judge
from islandgp.scoring.snapshot import Snapshot, measure
from islandgp.scoring.state import PopulationState, population_state
from islandgp.seeding import world_seed


def worlds_of(plan: Plan, seed: int, generation: int) -> tuple[int, ...]:
    """World seeds of a generation: one an episode, or one an individual and episode."""
    since = {"generation": generation, "epoch": plan.curriculum.epoch(generation), "never": 0}
    n = plan.gp.episodes * (1 if plan.gp.common_world else plan.gp.population)
    day = since[plan.gp.new_worlds]
    return tuple(world_seed(seed, generation=day, episode=i) for i in range(n))


def evaluate(
    plan: Plan,
    generation: int,
    population: Sequence[Individual],
    texts: Sequence[str],
    worlds: Sequence[int],
    evaluator: Evaluator,
) -> tuple[Evaluated, ...]:
    """The individuals, whose canonical texts are `texts`, with what they achieve in the worlds."""
    n, stage = plan.gp.episodes, plan.curriculum.stage(generation)
    jobs = [
        Job(text, stage, worlds[e if plan.gp.common_world else i * n + e])
        for i, text in enumerate(texts)
        for e in range(n)
    ]
    outcomes = evaluator.evaluate(jobs)
    found = [combine(outcomes[i : i + n]) for i in range(0, len(outcomes), n)]
    return tuple(
        Evaluated(i, o, judge(o, plan.classes), o.fitness)
        for i, o in zip(population, found, strict=True)
    )


def combine(outcomes: Sequence[Outcome]) -> Outcome:
    """The mean of several episodes, number by number; one episode's outcome is itself."""
    if len(outcomes) == 1:
        return outcomes[0]
    first, n = outcomes[0], len(outcomes)
    return Outcome(
        components={c: total(o.components[c] for o in outcomes) / n for c in first.components},
        counters={c: total(o.counters[c] for o in outcomes) / n for c in first.counters},
        seconds=total(o.seconds for o in outcomes) / n,
        endings=tuple(ending for o in outcomes for ending in o.endings),
    )


def snapshot(plan: Plan, generation: int, population: Sequence[Evaluated], rate: float) -> Snapshot:
    """Line 5: a generation in numbers; `rate` is the mutation rate that made it."""
    return measure(
        [e.outcome for e in population],
        [e.verdict for e in population],
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
        plan.classes,
        crossover_rate=plan.gp.crossover_rate,
        population=plan.gp.population,
        generations=plan.gp.generations,
        generations_per_epoch=plan.curriculum.generations_per_epoch,
        multipliers=dict(plan.curriculum.multipliers(stage)),
    )
