"""How large random trees become under given settings: to refuse settings that never end."""

from __future__ import annotations

from typing import Final

from islandgp.bt.node import KINDS
from islandgp.evolution.generation import TreeSettings
from islandgp.evolution.plan import GP

MOST_NODES: Final = 2000.0  # expected of a random tree; a run takes at most 1,000


def expected_nodes(trees: TreeSettings, depth: int) -> float:
    """Mean nodes of `generation.grow` with this depth, >= 1; counted up to MOST_NODES."""
    weight = sum(trees.kinds.values())
    several = sum(w for kind, w in trees.kinds.items() if KINDS[kind].children[1] != 1) / weight
    children = 1 - several + several * sum(trees.children) / 2
    nodes = 1.0
    for _ in range(1, depth):
        before, nodes = nodes, trees.leaf + (1 - trees.leaf) * (1 + children * nodes)
        if nodes > MOST_NODES or nodes == before:
            break
    return nodes


def check_growth(gp: GP) -> None:
    """Raises ValueError where making random trees would take for ever.

    A tree that is too large is made all the same before another one is tried.
    """
    trees, most = gp.trees, gp.trees.depth[1]
    if most > 1000:
        raise ValueError(f"gp.trees.depth: expected at most 1000 levels, found {most}")
    if gp.mutation.subtree_depth > gp.max_depth:
        raise ValueError(
            f"gp.mutation.subtree_depth: expected at most gp.max_depth={gp.max_depth},"
            f" found {gp.mutation.subtree_depth}"
        )
    if trees.children[1] > gp.max_nodes:
        raise ValueError(
            f"gp.trees.children: expected at most gp.max_nodes={gp.max_nodes} children,"
            f" found {trees.children[1]}"
        )
    depths = [min(depth, gp.max_depth) for depth in range(trees.depth[0], most + 1)]
    for key, found in (
        ("gp.trees.depth", sum(expected_nodes(trees, depth) for depth in depths) / len(depths)),
        ("gp.mutation.subtree_depth", expected_nodes(trees, gp.mutation.subtree_depth)),
    ):
        if found > MOST_NODES:
            raise ValueError(
                f"{key}: expected random trees of at most {MOST_NODES:,.0f} nodes on average,"
                " found larger ones; lower it or gp.trees.children, or raise gp.trees.leaf"
            )
