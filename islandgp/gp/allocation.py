"""Composition of the next population: Table 1 (section 2.3).

The slots are filled in this order: elites, behavioural elites, resurrected individuals, the
supervisor's tree, random trees (the diversity slots), and tournament children. Mutation is applied
afterwards by the search.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from islandgp.bt.core.node import Node
from islandgp.gp.plan import Allocation, Plan
from islandgp.gp.population import (
    BehaviourArchive,
    BehaviourBest,
    EditedTree,
    Evaluated,
    Individual,
    Origin,
    edited_individuals,
    ranked,
)
from islandgp.gp.random_trees import random_tree
from islandgp.gp.selection import pick_parent, selection
from islandgp.gp.variation import crossover
from islandgp.seeding import Stream, Streams


def update_behaviour_archive(
    archive: BehaviourArchive,
    population: Sequence[Evaluated],
    behaviours: Sequence[str],
    stage: int,
) -> dict[str, BehaviourBest]:
    """The archive updated with the best individual of each behaviour in this generation.

    Stages of the curriculum have different scales, so an individual of a later stage replaces one
    of an earlier stage regardless of fitness.
    """
    updated = dict(archive)
    for e in population:
        for behaviour in e.labels.behaviours:
            best = updated.get(behaviour)
            if best is None or (stage, e.merit) > (best.stage, best.merit):
                i = e.individual
                updated[behaviour] = BehaviourBest(i.id, i.tree, stage, e.fitness, e.violation)
    return {name: updated[name] for name in behaviours if name in updated}


def scaled(count: int, allocation: Allocation, population: int) -> int:
    """A count of Table 1 scaled to the population size, rounded half up; at least 1 if it was."""
    return max(min(count, 1), (2 * count * population + allocation.per) // (2 * allocation.per))


def diversity_slots(
    allocation: Allocation, population: int, reserved: int, diversity: float
) -> int:
    """The number of diversity slots, within the ranges of Table 1: more if diversity is low."""
    fewest, most = (max(1, scaled(n, allocation, population)) for n in allocation.diversity)
    fewest_children, most_children = (
        scaled(n, allocation, population) for n in allocation.tournament_children
    )
    enough, low = allocation.diversity_targets
    middle = (fewest + most + 1) // 2
    slots = fewest if diversity >= enough else most if diversity < low else middle
    free = population - reserved
    slots = max(slots, min(most, free - most_children))
    return max(min(slots, free - fewest_children), min(fewest, free))


class Survivor(NamedTuple):
    """An unchanged tree in the next population."""

    origin: Origin
    parent: str  # id
    tree: Node


def elites(
    population: Sequence[Evaluated],
    allocation: Allocation,
    archive: BehaviourArchive,
    behaviours: Sequence[str],
) -> list[Survivor]:
    """The elites, behavioural elites and resurrected individuals of the next population."""
    n, order = len(population), ranked(tuple(population))
    best = order[: scaled(allocation.elites, allocation, n)]
    elite_ids = {e.individual.id for e in best}
    slots = [Survivor(Origin.ELITE, e.individual.id, e.individual.tree) for e in best]
    room = scaled(allocation.behavioural_elites, allocation, n)
    for behaviour in behaviours:
        i = next((e.individual for e in order if behaviour in e.labels.behaviours), None)
        if room and i is not None and i.id not in elite_ids:
            elite_ids.add(i.id)
            room -= 1
            slots.append(Survivor(Origin.BEHAVIOURAL_ELITE, i.id, i.tree))
    alive = {behaviour for e in population for behaviour in e.labels.behaviours}
    # An individual may be the best of several behaviours; it is resurrected once.
    extinct = list({a.id: a for name, a in archive.items() if name not in alive}.values())
    slots += [
        Survivor(Origin.RESURRECTED, a.id, a.tree)
        for a in extinct[: scaled(allocation.resurrected, allocation, n)]
    ]
    return slots


def next_population(
    plan: Plan,
    population: Sequence[Evaluated],
    *,
    streams: Streams,
    generation: int,
    injected: Node | None,
    archive: BehaviourArchive,
    diversity: float,
    edited: Sequence[EditedTree] = (),
) -> Iterator[Individual]:
    """Yields the population of `generation`, before mutation, of the same size as the last one.

    Edited trees replace tournament children.
    """
    n, allocation = len(population), plan.allocation
    survivors = elites(population, allocation, archive, plan.classes.elite_behaviours)[
        : n - 2 - len(edited)
    ]
    for slot, s in enumerate(survivors):
        yield Individual(f"{generation}.{slot}", s.tree, s.origin, (s.parent,))
    first = len(survivors)  # diversity slot
    end = first + diversity_slots(allocation, n, first + len(edited), diversity)
    for slot in range(first, end):
        if slot == first and injected is not None:
            yield Individual(f"{generation}.{slot}", injected, Origin.INJECTED)
            continue
        rng = streams(Stream.DIVERSITY, generation=generation, slot=slot)
        yield Individual(f"{generation}.{slot}", random_tree(rng, plan.space), Origin.RANDOM)
    yield from edited_individuals(edited, generation, end)
    yield from _children(plan, population, streams, generation, end + len(edited))


def _children(
    plan: Plan, population: Sequence[Evaluated], streams: Streams, generation: int, first: int
) -> Iterator[Individual]:
    """Yields the tournament children in the slots from `first` on."""
    n, gp = len(population), plan.gp
    select, cross = selection(gp.selection), crossover(gp.crossover)
    supplied: Counter[str] = Counter()
    limit = plan.allocation.niche_share * (n - first) * (1 + gp.crossover_rate)
    for slot in range(first, n):
        rng = streams(Stream.SELECTION, generation=generation, slot=slot)
        parents = []
        for _ in range(2 if rng.random() < gp.crossover_rate else 1):
            e = pick_parent(
                rng, select, population, supplied, most=limit, entrants=gp.tournament_size
            )
            supplied[e.labels.specialist] += 1
            parents.append(e.individual)
        tree, origin = parents[0].tree, Origin.COPY
        if len(parents) > 1:
            rng = streams(Stream.CROSSOVER, generation=generation, slot=slot)
            crossed = cross(rng, tree, parents[1].tree, gp.limits)
            tree, origin = plan.space.repaired(crossed), Origin.CROSSOVER
        ids = tuple(parent.id for parent in parents)
        yield Individual(f"{generation}.{slot}", tree, origin, ids)
