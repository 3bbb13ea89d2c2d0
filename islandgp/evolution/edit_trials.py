"""Compares the trees of a supervisor's edits with the trees before the edit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from islandgp.domain import total
from islandgp.evaluation.base import Evaluator, Job
from islandgp.gp.edits import EditTrial
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated, Origin


def compare_with_parents(
    plan: Plan,
    population: Sequence[Evaluated],
    texts: Sequence[str],
    worlds: Sequence[int],
    parents: Mapping[str, str],
    evaluator: Evaluator,
    *,
    stage: int,
) -> tuple[tuple[EditTrial, ...], int]:
    """Compares each edited tree with the original tree in the same worlds.

    An original tree that is in the population, and so was evaluated in these worlds, is not
    evaluated again.

    Args:
        plan: of the run.
        population: the generation, evaluated.
        texts: the canonical texts of its trees.
        worlds: of the generation.
        parents: texts of the original trees by id.
        evaluator: runs the episodes.
        stage: of the curriculum.

    Returns:
        The comparisons, and the number of additional episodes.
    """
    n, common = plan.gp.episodes, plan.gp.shared_seed
    fitnesses = {
        (text, 0 if common else slot): e.fitness
        for slot, (text, e) in enumerate(zip(texts, population, strict=True))
    }
    pairs = [
        (e, parents[e.individual.parents[0]], 0 if common else slot)
        for slot, e in enumerate(population)
        if e.individual.origin == Origin.EDITED and e.individual.parents[0] in parents
    ]
    missing = [
        key for key in dict.fromkeys((text, at) for _, text, at in pairs) if key not in fitnesses
    ]
    jobs = [Job(text, stage, worlds[at * n + k]) for text, at in missing for k in range(n)]
    outcomes = evaluator.evaluate(jobs) if jobs else []
    for k, key in enumerate(missing):
        fitnesses[key] = float(total(o.fitness for o in outcomes[k * n : (k + 1) * n]) / n)
    trials = tuple(
        EditTrial(e.individual.id, e.individual.parents[0], e.fitness, fitnesses[text, at])
        for e, text, at in pairs
    )
    return trials, len(jobs)
