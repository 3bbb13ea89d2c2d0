"""Mutation, after a population is constructed (section 2.3; line 15 of Algorithm 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from islandgp.bt.limits import Limits, within
from islandgp.bt.node import Node
from islandgp.evolution.generation import TreeSettings, weighted
from islandgp.evolution.operators import MUTATIONS, MutationSettings
from islandgp.evolution.population import Individual, Origin
from islandgp.seeding import Stream, stream

TRIES: Final = 8  # attempts at a mutation that keeps the limits and changes something
SPARED: Final = (Origin.ELITE, Origin.BEHAVIOURAL_ELITE, Origin.INJECTED)
"""Whom mutation leaves alone where `gp.mutate_elites` is false."""


def mutate(
    rng: np.random.Generator,
    tree: Node,
    *,
    rate: float,
    trees: TreeSettings,
    how: MutationSettings,
    limits: Limits,
) -> tuple[Node, str]:
    """With chance `rate`, one mutation: (new tree, its operator), else (the same tree, "").

    A mutation that breaks the limits or changes nothing is tried again; after
    TRIES attempts the tree stays as it is.
    """
    if rng.random() >= rate:
        return tree, ""
    for _ in range(TRIES):
        name = weighted(rng, how.operators)
        new = MUTATIONS[name](rng, tree, trees, how)
        if new != tree and within(new, limits):
            return new, name
    return tree, ""


def mutate_population(
    population: Sequence[Individual],
    *,
    seed: int,
    generation: int,
    rate: float,
    elites_too: bool,
    trees: TreeSettings,
    how: MutationSettings,
    limits: Limits,
) -> tuple[Individual, ...]:
    """Mutation after construction; with `elites_too` it spares nobody (section 2.4.3)."""
    new = []
    for slot, i in enumerate(population):
        if elites_too or i.origin not in SPARED:
            rng = stream(seed, Stream.MUTATION, generation=generation, slot=slot)
            tree, operator = mutate(rng, i.tree, rate=rate, trees=trees, how=how, limits=limits)
            i = replace(i, tree=tree, mutation=operator)
        new.append(i)
    return tuple(new)
