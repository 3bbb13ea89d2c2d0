"""Line 4 of Algorithm 1: every individual in its episodes, and what it is worth."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.evaluation.base import Evaluator, Job
from islandgp.evolution.plan import Plan
from islandgp.evolution.population import Evaluated, Individual
from islandgp.scoring.classify import specialist, tiers
from islandgp.scoring.outcome import combine
from islandgp.scoring.snapshot import behaviours
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
        Evaluated(
            i, o, specialist(o, plan.classes), tiers(o, plan.classes), behaviours(o, plan.classes)
        )
        for i, o in zip(population, found, strict=True)
    )
