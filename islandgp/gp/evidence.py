"""The evaluations of trees, and estimates of their mean fitness in different worlds.

All individuals of a generation are evaluated in the same worlds, and worlds differ more than good
trees do. So fitness is modelled as a tree's level plus the generation's effect. Both are estimated
jointly, with shrinkage of the effects as in random-effects models (Henderson 1975).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from math import sqrt
from statistics import fmean, pstdev
from typing import Final

from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import Node
from islandgp.gp.population import Evaluated, Tree
from islandgp.scoring.constraints import running_mean

SHRINKAGE: Final = 0.3  # default of the residual variance over the variance of generations' effects
ROUNDS: Final = 20  # of alternating estimates


@dataclass(frozen=True, slots=True)
class Evidence:
    """A tree with its evaluations so far, one a generation."""

    id: str  # of its last individual
    tree: Tree
    digest: str  # of the tree
    fitness: tuple[tuple[int, float], ...]  # (generation, points), oldest first
    means: dict[str, float]  # over its evaluations, of the values that a search needs
    outcome_key: str  # of its last outcome; equal for trees that earned the same points


def digest(tree: Node) -> str:
    """The first 12 hexadecimal digits of the SHA-256 of a tree's canonical text."""
    return sha256(to_text(tree).encode()).hexdigest()[:12]


def with_evaluation(
    before: Evidence | None, e: Evaluated, generation: int, values: Mapping[str, float]
) -> Evidence:
    """The evidence of a tree after one more evaluation.

    Args:
        before: the evidence so far; None at its first evaluation.
        e: the evaluation.
        generation: of the evaluation.
        values: of the evaluation, whose means are kept; the same names each time.
    """
    i, now = e.individual, (generation, e.fitness)
    key = repr((e.fitness, sorted(e.outcome.components.items())))
    if before is None:
        return Evidence(i.id, i.tree, digest(i.tree), (now,), dict(values), key)
    fitness = (*before.fitness, now)
    means = running_mean(before.means, values, len(fitness))
    return replace(before, id=i.id, fitness=fitness, means=means, outcome_key=key)


def estimate(
    fitness: Sequence[Mapping[int, float]], shrinkage: float = SHRINKAGE
) -> tuple[list[float], float]:
    """The level of each tree, and the standard deviation of a single evaluation around it.

    Args:
        fitness: points by generation, of each tree; at least one evaluation each.
        shrinkage: residual variance over the variance of generations' effects, >= 0. The larger
            it is, the nearer are the levels to plain means.

    Returns:
        The levels in points, and the residual standard deviation in points, pooled over trees.
        If no tree was evaluated twice, it is the standard deviation between trees.
    """
    if not fitness:
        return [], 0.0
    points = [list(values.items()) for values in fitness]
    repeated = [values for values in points if len(values) > 1]
    counts = Counter(g for values in repeated for g, _ in values)
    effects = {g: 0.0 for values in points for g, _ in values}
    for _ in range(ROUNDS if repeated else 0):
        sums = dict.fromkeys(counts, 0.0)
        for values in repeated:
            level = fmean([v - effects[g] for g, v in values])
            for g, v in values:
                sums[g] += v - level
        effects.update({g: sums[g] / (counts[g] + shrinkage) for g in sums})
    levels = [fmean([v - effects[g] for g, v in values]) for values in points]
    squares, freedom = 0.0, 0
    for values, level in zip(points, levels, strict=True):
        squares += sum((v - effects[g] - level) ** 2 for g, v in values)
        freedom += len(values) - 1
    if not freedom:
        return levels, pstdev(levels)
    return levels, sqrt(squares / freedom)
