"""How the searches beside the paper's make trees: random ones, and children of parents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, Field, model_validator

from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import Node, within
from islandgp.gp.branches import random_list
from islandgp.gp.plan import Plan
from islandgp.gp.population import (
    EditedTree,
    Individual,
    Origin,
    Tree,
    edited_individuals,
)
from islandgp.gp.random_trees import TreeSpace, check_weights, random_tree, weighted
from islandgp.gp.variation import CROSSOVERS, MutationSettings, crossover, mutate
from islandgp.seeding import Stream, Streams

TRIES: Final = 30  # attempts at a tree that was not tried before


class Breeding(BaseModel, frozen=True, extra="forbid"):
    """How new trees are made."""

    lists: float = Field(ge=0, le=1)  # share of random trees that are priority lists
    crossover_rate: float = Field(ge=0, le=1)  # share of children with two parents
    crossovers: dict[str, float]  # weight of each of CROSSOVERS, or of a "module:function"
    mutation: MutationSettings
    further: float = Field(ge=0, lt=1)  # chance of one more mutation after each
    simplify: bool  # new trees lose what is proven to have no effect

    @model_validator(mode="after")
    def _known(self) -> Breeding:
        own = [name for name in self.crossovers if ":" in name]
        for name in own:
            crossover(name)
        check_weights("crossovers", self.crossovers, [*CROSSOVERS, *own])
        return self


def digest(tree: Node) -> str:
    """12 hexadecimal digits that tell trees apart."""
    return sha256(to_text(tree).encode()).hexdigest()[:12]


def new_tree(rng: np.random.Generator, space: TreeSpace, how: Breeding) -> Node:
    """A random tree: a priority list with chance `how.lists`, else as the paper grows it."""
    for _ in range(TRIES):
        lists = rng.random() < how.lists
        tree = random_list(rng, space) if lists else random_tree(rng, space)
        if how.simplify:
            tree = simplify(tree, space.vocabulary).tree
        if within(tree, space.limits):
            return tree
    return random_tree(rng, space)


@dataclass(frozen=True, slots=True)
class Parent:
    """A tree that may have children."""

    id: str  # of the individual
    tree: Tree


def new_child(
    rng: np.random.Generator,
    mother: Parent,
    fathers: Sequence[Parent],
    space: TreeSpace,
    how: Breeding,
) -> tuple[Node, tuple[str, ...], str]:
    """A child of `mother`, and perhaps of one of `fathers`, within the limits.

    Args:
        rng: is consumed.
        mother: whose tree is changed.
        fathers: other trees, whose parts may come into it; may be empty.
        space: the trees that are searched.
        how: which operators, and how often.

    Returns:
        The tree, the ids of its parents, and its mutations joined by "+", or "".
    """
    tree, parents = mother.tree, [mother.id]
    if fathers and rng.random() < how.crossover_rate:
        father = fathers[int(rng.integers(len(fathers)))]
        cross = crossover(weighted(rng, how.crossovers))
        crossed = cross(rng, tree, father.tree, space.limits)
        if crossed != tree:
            tree = crossed
            parents += [father.id] if father.id else []
    changes: list[str] = []
    while not changes or rng.random() < how.further:
        if tree != mother.tree and not changes and rng.random() < CROSSED_ONLY:
            break
        tree, change = mutate(rng, tree, rate=1.0, space=space, how=how.mutation)
        changes.append(change)
    if how.simplify:
        tree = simplify(tree, space.vocabulary).tree
    return tree, tuple(parents), "+".join(change for change in changes if change)


CROSSED_ONLY: Final = 0.7  # chance that a child of two parents is not mutated as well


def unseen(make: Callable[[], tuple[Node, Any]], tried: set[str]) -> tuple[Node, Any]:
    """What `make` gives, called again while its tree is among `tried`; adds the tree to them.

    After TRIES calls a tree that was tried before is returned.
    """
    for _ in range(TRIES):
        tree, more = make()
        if digest(tree) not in tried:
            break
    tried.add(digest(tree))
    return tree, more


def random_individuals(
    streams: Streams,
    generation: int,
    slots: range,
    space: TreeSpace,
    how: Breeding,
    tried: set[str],
) -> list[Individual]:
    """New random trees for these slots, none of which was tried before if there are such."""
    made = []
    for slot in slots:
        rng = streams(Stream.SEARCH, generation=generation, slot=slot)

        def make(rng: np.random.Generator = rng) -> tuple[Node, None]:
            return new_tree(rng, space, how), None

        tree, _ = unseen(make, tried)
        made.append(Individual(f"{generation}.{slot}", tree, Origin.RANDOM))
    return made


def children(
    streams: Streams,
    generation: int,
    slots: range,
    pick: Callable[[np.random.Generator], tuple[Parent, Sequence[Parent]]],
    space: TreeSpace,
    how: Breeding,
    tried: set[str],
) -> list[Individual]:
    """A child for each slot; `pick` draws its mother, and who may be its father."""
    made = []
    for slot in slots:
        rng = streams(Stream.SEARCH, generation=generation, slot=slot)

        def make(rng: np.random.Generator = rng) -> tuple[Node, tuple[tuple[str, ...], str]]:
            mother, fathers = pick(rng)
            tree, parents, changes = new_child(rng, mother, fathers, space, how)
            return tree, (parents, changes)

        tree, (parents, changes) = unseen(make, tried)
        origin = Origin.CROSSOVER if len(parents) > 1 else Origin.COPY
        made.append(Individual(f"{generation}.{slot}", tree, origin, parents, changes))
    return made


def first_generation(plan: Plan, streams: Streams, how: Breeding) -> tuple[Individual, ...]:
    """The plan's founders, then random trees."""
    founders = plan.founders[: plan.gp.population]
    given = [Individual(f"0.{k}", tree, Origin.INJECTED) for k, tree in enumerate(founders)]
    slots = range(len(given), plan.gp.population)
    tried = {digest(tree) for tree in founders}
    return (*given, *random_individuals(streams, 0, slots, plan.space, how, tried))


def next_generation(
    plan: Plan,
    streams: Streams,
    generation: int,
    *,
    again: Sequence[Parent],
    tree: Node | None,
    pick: Callable[[np.random.Generator], tuple[Parent, Sequence[Parent]]],
    how: Breeding,
    known: Iterable[Node] = (),
    edited: Sequence[EditedTree] = (),
) -> tuple[Individual, ...]:
    """Trees that are evaluated again, the supervisor's trees, and children for the other slots.

    Args:
        plan: of the run.
        streams: of the run.
        generation: whose individuals are made, >= 1.
        again: trees that are evaluated again, the most important first; at least two slots are
            left for others.
        tree: of the supervisor, or None.
        pick: draws a child's mother, and who may be its father.
        how: children are made.
        known: further trees that no child should equal.
        edited: of the supervisor.
    """
    n = plan.gp.population
    kept = [
        Individual(f"{generation}.{slot}", parent.tree, Origin.ELITE, (parent.id,))
        for slot, parent in enumerate(again[: n - 2 - len(edited)])
    ]
    if tree is not None:
        kept.append(Individual(f"{generation}.{len(kept)}", tree, Origin.INJECTED))
    kept += edited_individuals(edited, generation, len(kept))
    tried = {digest(old) for old in (*(i.tree for i in kept), *known)}
    slots = range(len(kept), n)
    return (*kept, *children(streams, generation, slots, pick, plan.space, how, tried))
