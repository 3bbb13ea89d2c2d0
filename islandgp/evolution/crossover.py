"""Subtree crossover (section 2.3)."""

from __future__ import annotations

import numpy as np

from islandgp.bt.limits import Limits
from islandgp.bt.node import Node, levels, measured, replace_at, size, walk


def crossover(rng: np.random.Generator, mother: Node, father: Node, limits: Limits) -> Node:
    """Subtree crossover: a random subtree of `mother` gives way to one of `father` that fits."""
    nodes, depths = list(walk(mother)), levels(mother)
    cut = int(rng.integers(len(nodes)))
    room = limits.max_nodes - len(nodes) + size(nodes[cut])
    below = limits.max_depth - depths[cut] + 1
    donors = [node for node, n, d in measured(father) if n <= room and d <= below]
    if not donors:
        return mother
    return replace_at(mother, cut, donors[rng.integers(len(donors))])
