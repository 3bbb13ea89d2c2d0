"""Selection, subtree crossover and mutation (section 2.3).

Each operator is a function of the trees and a generator, which it consumes.
The limits always hold: a child that would break them is not made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from pydantic import BaseModel, Field, model_validator

from islandgp.bt.limits import Limits, within
from islandgp.bt.node import KEYS, KINDS, REPEATS, Node, size, walk
from islandgp.evolution.generation import (
    TreeSettings,
    check_weights,
    grow,
    inner_node,
    random_action,
    random_args,
    weighted,
)
from islandgp.evolution.population import Evaluated

TRIES = 8  # attempts at a mutation that keeps the limits and changes something


class MutationSettings(BaseModel, frozen=True, extra="forbid"):
    """Which mutations there are, and how strong."""

    operators: dict[str, float]  # weight of each operator of MUTATIONS
    subtree_depth: int = Field(ge=1)  # most levels of a new subtree
    number_sd: float = Field(gt=0, le=1)  # sd of a number's change, as a share of its key's range

    @model_validator(mode="after")
    def _operators_exist(self) -> MutationSettings:
        check_weights("operators", self.operators, MUTATIONS)
        return self


def replace_at(tree: Node, index: int, new: Node) -> Node:
    """The tree with its node number `index` (document order, root 0) replaced by `new`."""
    if index == 0:
        return new
    index -= 1
    for i, child in enumerate(tree.children):
        n = size(child)
        if index < n:
            child = replace_at(child, index, new)
            return tree._replace(children=(*tree.children[:i], child, *tree.children[i + 1 :]))
        index -= n
    raise IndexError("expected an index below the tree's size")


def levels(tree: Node, level: int = 1) -> list[int]:
    """The level of each node, the root's being 1, in document order."""
    return [level, *(below for child in tree.children for below in levels(child, level + 1))]


def measured(tree: Node) -> list[tuple[Node, int, int]]:
    """Each node with its size and depth, in document order."""
    below: list[tuple[Node, int, int]] = []
    depths = [0]
    for child in tree.children:
        nodes = measured(child)
        depths.append(nodes[0][2])
        below += nodes
    return [(tree, 1 + len(below), 1 + max(depths)), *below]


def tournament(
    rng: np.random.Generator, population: Sequence[Evaluated], entrants: int
) -> list[Evaluated]:
    """Entrants of one tournament (drawn with replacement), best first; the first has won."""
    drawn = [population[i] for i in rng.integers(len(population), size=entrants)]
    return sorted(drawn, key=lambda e: -e.fitness)


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


def _subtree(
    rng: np.random.Generator, tree: Node, trees: TreeSettings, how: MutationSettings
) -> Node:
    """A new random subtree in place of an old one."""
    return replace_at(tree, int(rng.integers(size(tree))), grow(rng, trees, how.subtree_depth))


def _node(rng: np.random.Generator, tree: Node, trees: TreeSettings, _: MutationSettings) -> Node:
    """Another kind of node, or another action, in the same place with the same children."""
    nodes = list(walk(tree))
    i = int(rng.integers(len(nodes)))
    old = nodes[i]
    if old.kind == "action":
        return replace_at(tree, i, random_action(rng))
    n = len(old.children)
    kinds = [
        name
        for name, kind in KINDS.items()
        if trees.kinds.get(name, 0) > 0 and kind.children[0] <= n <= kind.children[1]
    ]
    if not kinds:
        return tree
    kind = kinds[rng.integers(len(kinds))]
    return replace_at(tree, i, Node(kind, random_args(rng, kind, trees), old.children))


def _parameter(
    rng: np.random.Generator, tree: Node, trees: TreeSettings, how: MutationSettings
) -> Node:
    """A nudged number, or a new argument, of one node that has arguments."""
    nodes = [
        (i, node) for i, node in enumerate(walk(tree)) if KINDS[node.kind].args and node.children
    ]
    if not nodes:
        return tree
    i, old = nodes[rng.integers(len(nodes))]
    args = random_args(rng, old.kind, trees)
    nudge = rng.normal(0, how.number_sd)
    if old.kind == "repeater":
        least, most = REPEATS
        args = (float(min(most, max(least, round(float(old.args[0]) + nudge * trees.repeats)))),)
    elif old.kind == "when" and not KEYS[str(old.args[0])].flag and rng.random() < 0.5:
        args = (*old.args[:2], _nudged(old, nudge), old.args[3])
    return replace_at(tree, i, old._replace(args=args))


def _nudged(guard: Node, nudge: float) -> float:
    """A guard's number moved by `nudge` ranges of its key, on the key's grid."""
    key = KEYS[str(guard.args[0])]
    moved = float(guard.args[2]) + nudge * (key.high - key.low)
    on_grid = key.low + round((moved - key.low) / key.step) * key.step
    return min(key.high, max(key.low, on_grid))


def _insert(
    rng: np.random.Generator, tree: Node, trees: TreeSettings, how: MutationSettings
) -> Node:
    """A new inner node above a node, or a new child in a composite."""
    nodes = list(walk(tree))
    i = int(rng.integers(len(nodes)))
    old = nodes[i]
    if old.children and KINDS[old.kind].children[1] > 1 and rng.random() < 0.5:
        at = int(rng.integers(len(old.children) + 1))
        new = grow(rng, trees, how.subtree_depth)
        return replace_at(
            tree, i, old._replace(children=(*old.children[:at], new, *old.children[at:]))
        )
    parent = inner_node(rng, trees, 2)
    at = int(rng.integers(len(parent.children)))
    children = (*parent.children[:at], old, *parent.children[at + 1 :])
    return replace_at(tree, i, parent._replace(children=children))


def _delete(rng: np.random.Generator, tree: Node, _: TreeSettings, __: MutationSettings) -> Node:
    """One child less in a composite, or an inner node's place taken by a child of it."""
    inner = [(i, node) for i, node in enumerate(walk(tree)) if node.children]
    if not inner:
        return tree
    i, old = inner[rng.integers(len(inner))]
    at = int(rng.integers(len(old.children)))
    if len(old.children) > 1 and rng.random() < 0.5:
        return replace_at(
            tree, i, old._replace(children=old.children[:at] + old.children[at + 1 :])
        )
    return replace_at(tree, i, old.children[at])


def _swap(rng: np.random.Generator, tree: Node, _: TreeSettings, __: MutationSettings) -> Node:
    """Two children of a composite change places."""
    wide = [(i, node) for i, node in enumerate(walk(tree)) if len(node.children) > 1]
    if not wide:
        return tree
    i, old = wide[rng.integers(len(wide))]
    a, b = (int(k) for k in rng.choice(len(old.children), 2, replace=False))
    children = list(old.children)
    children[a], children[b] = children[b], children[a]
    return replace_at(tree, i, old._replace(children=tuple(children)))


Mutation = Callable[[np.random.Generator, Node, TreeSettings, MutationSettings], Node]

MUTATIONS: Final[dict[str, Mutation]] = {
    "subtree": _subtree,
    "node": _node,
    "parameter": _parameter,
    "insert": _insert,
    "delete": _delete,
    "swap": _swap,
}


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
