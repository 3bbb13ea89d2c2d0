"""Who makes up the next population: Table 1 (section 2.3).

The slots are filled in a fixed order: elites, behavioural elites, resurrected,
the supervisor's tree and random ones for diversity, and tournament children for
the rest. Mutation comes afterwards and is not decided here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pydantic import BaseModel, Field, model_validator

from islandgp.bt.node import Node
from islandgp.evolution.population import Ancestor, Archive, Evaluated, Individual, Origin, ranked
from islandgp.evolution.random_trees import TreeSpace, random_tree
from islandgp.evolution.selection import Selection, pick_parent
from islandgp.evolution.variation import Crossover
from islandgp.seeding import Stream, stream


class Allocation(BaseModel, frozen=True, extra="forbid"):
    """Table 1. Counts are for `per` individuals and scale with the population."""

    per: int = Field(ge=1)
    elites: int = Field(ge=0)  # at most
    behavioural_elites: int = Field(ge=0)  # at most
    resurrected: int = Field(ge=0)  # at most
    diversity: tuple[int, int]  # least and most
    tournament: tuple[int, int]  # least and most
    diversity_targets: tuple[
        float, float
    ]  # Eq. (3): at or above the first the least slots, below the second the most
    niche_share: float = Field(gt=0, le=1)  # a class gives at most this share of the parents

    @model_validator(mode="after")
    def _ranges(self) -> Allocation:
        lowest = {"diversity": 1, "tournament": 0}  # without children it is a random search
        for name in lowest:
            least, most = getattr(self, name)
            if not lowest[name] <= least <= most:
                raise ValueError(
                    f"{name}: expected {lowest[name]} <= least <= most, found [{least}, {most}]"
                )
        enough, low = self.diversity_targets
        if not 0 <= low <= enough <= 1:
            raise ValueError(
                f"diversity_targets: expected 1 >= first >= second >= 0, found [{enough}, {low}]"
            )
        taken = self.elites + self.behavioural_elites + self.resurrected + self.diversity[0]
        if taken + self.tournament[0] > self.per:
            raise ValueError(
                f"expected slots that fit into {self.per} individuals, found"
                f" {taken} and at least {self.tournament[0]} tournament children"
            )
        return self


def remember(
    archive: Archive, population: Sequence[Evaluated], behaviours: Sequence[str], stage: int
) -> dict[str, Ancestor]:
    """The archive with this generation's best of each behaviour, where they are better.

    Stages of the curriculum have scales of their own: what shows a behaviour in a later one
    replaces the best of an earlier one, whatever their fitness.
    """
    kept = dict(archive)
    for e in population:
        for behaviour in e.verdict.behaviours:
            best = kept.get(behaviour)
            if best is None or (stage, e.fitness) > (best.stage, best.fitness):
                kept[behaviour] = Ancestor(e.individual.id, e.individual.tree, stage, e.fitness)
    return {name: kept[name] for name in behaviours if name in kept}


def scaled(count: int, allocation: Allocation, population: int) -> int:
    """A count of Table 1 for another population size, rounded half up, but none lost."""
    return max(min(count, 1), (2 * count * population + allocation.per) // (2 * allocation.per))


def diversity_slots(allocation: Allocation, population: int, taken: int, diversity: float) -> int:
    """How many diversity slots: more when diversity is low, within Table 1's two ranges."""
    least, most = (max(1, scaled(n, allocation, population)) for n in allocation.diversity)
    few, many = (scaled(n, allocation, population) for n in allocation.tournament)
    enough, low = allocation.diversity_targets
    middle = (least + most + 1) // 2
    wanted = least if diversity >= enough else most if diversity < low else middle
    free = population - taken
    wanted = max(wanted, min(most, free - many))
    return max(min(wanted, free - few), min(least, free))


def elites(
    population: Sequence[Evaluated],
    allocation: Allocation,
    archive: Archive,
    behaviours: Sequence[str],
) -> list[tuple[Origin, str, Node]]:
    """Elites, the best of each behaviour, and resurrected ones: (origin, parent, tree)."""
    n, order = len(population), ranked(tuple(population))
    best = order[: scaled(allocation.elites, allocation, n)]
    taken = {e.individual.id for e in best}
    slots = [(Origin.ELITE, e.individual.id, e.individual.tree) for e in best]
    room = scaled(allocation.behavioural_elites, allocation, n)
    for behaviour in behaviours:
        first = next((e for e in order if behaviour in e.verdict.behaviours), None)
        if room and first is not None and first.individual.id not in taken:
            taken.add(first.individual.id)
            room -= 1
            slots.append((Origin.BEHAVIOURAL_ELITE, first.individual.id, first.individual.tree))
    alive = {behaviour for e in population for behaviour in e.verdict.behaviours}
    # One ancestor may be the best of several behaviours: it comes back once.
    extinct = list({a.id: a for name, a in archive.items() if name not in alive}.values())
    slots += [
        (Origin.RESURRECTED, a.id, a.tree)
        for a in extinct[: scaled(allocation.resurrected, allocation, n)]
    ]
    return slots


def next_population(
    population: Sequence[Evaluated],
    *,
    seed: int,
    generation: int,
    injected: Node | None,
    archive: Archive,
    behaviours: Sequence[str],
    diversity: float,
    allocation: Allocation,
    space: TreeSpace,
    select: Selection,
    entrants: int,
    cross: Crossover,
    crossover_rate: float,
) -> tuple[Individual, ...]:
    """The population of `generation`, before mutation; as many individuals as before."""
    n = len(population)
    kept = elites(population, allocation, archive, behaviours)[: n - 2]
    new = [
        Individual(f"{generation}.{slot}", tree, origin, (parent,))
        for slot, (origin, parent, tree) in enumerate(kept)
    ]
    for i in range(diversity_slots(allocation, n, len(new), diversity)):
        slot = len(new)
        if i == 0 and injected is not None:
            new.append(Individual(f"{generation}.{slot}", injected, Origin.INJECTED))
            continue
        rng = stream(seed, Stream.DIVERSITY, generation=generation, slot=slot)
        new.append(Individual(f"{generation}.{slot}", random_tree(rng, space), Origin.RANDOM))
    supplied: Counter[str] = Counter()
    most = allocation.niche_share * (n - len(new)) * (1 + crossover_rate)
    for slot in range(len(new), n):
        rng = stream(seed, Stream.SELECTION, generation=generation, slot=slot)
        parents = []
        for _ in range(2 if rng.random() < crossover_rate else 1):
            parent = pick_parent(rng, select, population, supplied, most=most, entrants=entrants)
            supplied[parent.verdict.specialist] += 1
            parents.append(parent.individual)
        new.append(_child(f"{generation}.{slot}", parents, seed, generation, slot, space, cross))
    return tuple(new)


def _child(
    name: str,
    parents: Sequence[Individual],
    seed: int,
    generation: int,
    slot: int,
    space: TreeSpace,
    cross: Crossover,
) -> Individual:
    ids = tuple(p.id for p in parents)
    if len(parents) == 1:
        return Individual(name, parents[0].tree, Origin.COPY, ids)
    rng = stream(seed, Stream.CROSSOVER, generation=generation, slot=slot)
    tree = cross(rng, parents[0].tree, parents[1].tree, space.limits)
    return Individual(name, tree, Origin.CROSSOVER, ids)
