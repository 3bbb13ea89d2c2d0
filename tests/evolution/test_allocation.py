"""Table 1: who makes up the next population, for many random evaluated populations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.domain import Outcome
from islandgp.gp.population import Advice, Evaluated, Individual, Origin, in_slots, ranked
from islandgp.gp.selection import pick_parent, tournament
from islandgp.search.paper import (
    Allocation,
    BehaviourArchive,
    Parents,
    diversity_slots,
    next_population,
    scaled,
    update_behaviour_archive,
)
from islandgp.seeding import Streams
from tests.composed import composed, composed_plan
from tests.profiles import examples
from tests.samples import CLASSES, evaluated, outcome
from tests.strategies import nodes

BEHAVIOURS = CLASSES.elite_behaviours
SEEDS = st.integers(0, 2**32 - 1)
COUNTS = st.integers(0, 4).map(float)
OUTCOMES = st.builds(
    lambda fitness, **counts: outcome(fitness=fitness, **counts),
    fitness=st.integers(-5000, 5000).map(float),
    pickups=COUNTS,
    interactions=COUNTS,
    deliveries=COUNTS,
    charges=COUNTS,
)
TREES = [
    parse(text)
    for text in (
        "PatrolWaypoint",
        "selector { SeekCharger ExecuteCharge }",
        "sequence { MoveToGarbage PickupGarbage }",
        "when isHumanoidWantToClear { MoveToHumanoid }",
        "repeater 2 { sequence { DeliverToClearingPoint inverter { PatrolWaypoint } } }",
    )
]


def people(outcomes: Sequence[Outcome]) -> tuple[Evaluated, ...]:
    """A population of generation 4 with these outcomes and a few different trees."""
    individuals = (evaluated(f"4.{i}", result) for i, result in enumerate(outcomes))
    return tuple(
        replace(e, individual=replace(e.individual, tree=TREES[i % len(TREES)]))
        for i, e in enumerate(individuals)
    )


def populations(size: int) -> st.SearchStrategy[tuple[Evaluated, ...]]:
    """Evaluated populations from all alike to all different."""
    kinds = st.lists(OUTCOMES, min_size=1, max_size=6)
    return kinds.flatmap(
        lambda few: st.lists(st.sampled_from(few), min_size=size, max_size=size)
    ).map(people)


def built(
    population: Sequence[Evaluated],
    *,
    seed: int = 1,
    injected: Node | None = None,
    archive: BehaviourArchive | None = None,
    allocation: Allocation | None = None,
) -> tuple[Individual, ...]:
    """The population of generation 5."""
    plan = composed_plan()
    if archive is None:
        archive = update_behaviour_archive({}, population, BEHAVIOURS, 0)
    proposals = next_population(
        replace(plan, allocation=allocation or plan.allocation),
        Parents(tuple(population), dict(archive)),
        Streams(seed),
        5,
        Advice(0.0, injected),
    )
    return tuple(in_slots(proposals, 5))


def archived(population: Sequence[Evaluated]) -> BehaviourArchive:
    """The archive after a first generation."""
    return update_behaviour_archive({}, population, BEHAVIOURS, 0)


def counted(new: Sequence[Individual]) -> Counter[str]:
    """Individuals by row of Table 1."""
    rows = {
        Origin.RANDOM: "diversity",
        Origin.INJECTED: "diversity",
        Origin.CROSSOVER: "tournament",
        Origin.COPY: "tournament",
    }
    return Counter(rows.get(i.origin, i.origin.value) for i in new)


def best(name: str, tree: Node, fitness: float) -> tuple[int, Evaluated]:
    """The best individual of a behaviour in the first stage."""
    e = evaluated(name, outcome(fitness))
    return 0, replace(e, individual=replace(e.individual, tree=tree))


def archives() -> st.SearchStrategy[BehaviourArchive]:
    """Any memory of earlier generations."""
    ancestor = st.builds(
        best,
        st.sampled_from(["1.3", "2.7", "3.1"]),
        st.sampled_from(TREES),
        st.just(1.0),
    )
    return st.dictionaries(st.sampled_from(BEHAVIOURS), ancestor)


@examples(max_examples=150)
@given(
    population=populations(30), archive=archives(), seed=SEEDS, tree=st.none() | nodes(max_leaves=4)
)
def test_table_1(
    population: tuple[Evaluated, ...],
    archive: BehaviourArchive,
    seed: int,
    tree: Node | None,
) -> None:
    """Each count of Table 1 stays in its range, and they add up to 30."""
    new = built(
        population,
        seed=seed,
        injected=tree,
        archive={**archive, **archived(population)},
    )
    counts = counted(new)
    assert len(new) == 30
    assert 0 <= counts["elite"] <= 2
    assert 0 <= counts["behavioural_elite"] <= 5
    assert 0 <= counts["resurrected"] <= 2
    assert 2 <= counts["diversity"] <= 4
    assert 18 <= counts["tournament"] <= 25


@examples(max_examples=100)
@given(data=st.data(), size=st.integers(4, 70), archive=archives(), seed=SEEDS)
def test_table_1_scales_with_the_population(
    data: st.DataObject, size: int, archive: BehaviourArchive, seed: int
) -> None:
    """Table 1 scales: populations keep their size, and every row its scaled range."""
    population = data.draw(populations(size))
    table = composed().allocation
    counts = counted(built(population, seed=seed, archive={**archive, **archived(population)}))
    assert sum(counts.values()) == size
    assert counts["elite"] <= scaled(2, table, size)
    assert counts["behavioural_elite"] <= scaled(5, table, size)
    assert counts["resurrected"] <= scaled(2, table, size)
    assert 1 <= counts["diversity"] <= max(1, scaled(4, table, size))
    # Roundings may pull against each other by one, and small populations keep one of each kind.
    assert max(0, scaled(18, table, size) - 3) <= counts["tournament"]
    assert counts["tournament"] <= scaled(25, table, size) + 1


@pytest.mark.parametrize(
    ("population", "expected"),
    [(30, [2, 5, 18, 25]), (60, [4, 10, 36, 50]), (12, [1, 2, 7, 10]), (15, [1, 3, 9, 13])],
)
def test_scaled(population: int, expected: list[int]) -> None:
    """Counts scale with the population, a half rounded up."""
    assert [scaled(n, composed().allocation, population) for n in (2, 5, 18, 25)] == expected


@pytest.mark.parametrize(
    ("used", "diversity", "slots"),
    [
        # between 2 and 4 slots: 2 from diversity 0.5 on, 3 below, 4 below 0.3
        (7, 0.75, 2),
        (7, 0.5, 2),
        (7, 0.49, 3),
        (7, 0.3, 3),
        (7, 0.29, 4),
        (7, 0.0, 4),
        (9, 0.0, 3),  # 4 would leave 17 tournament children, Table 1 wants 18
        (2, 0.75, 3),  # 2 would leave 26 tournament children, Table 1 allows 25
    ],
)
def test_diversity_slots(used: int, diversity: float, slots: int) -> None:
    """The less diversity, the more diversity slots, within Table 1's ranges."""
    assert diversity_slots(composed().allocation, 30, used, diversity) == slots


@examples(max_examples=60)
@given(population=populations(30), seed=SEEDS)
def test_elites_are_the_best(population: tuple[Evaluated, ...], seed: int) -> None:
    """The two fittest come first, unchanged, with their parent's id."""
    new = built(population, seed=seed)
    best = ranked(population)[:2]
    assert [(i.origin, i.parents, i.tree) for i in new[:2]] == [
        (Origin.ELITE, (e.individual.id,), e.individual.tree) for e in best
    ]
    fitness = [e.fitness for e in ranked(population)]
    assert fitness == sorted(fitness, reverse=True)


@examples(max_examples=60)
@given(population=populations(30), seed=SEEDS)
def test_behavioural_elites(population: tuple[Evaluated, ...], seed: int) -> None:
    """The best of each behaviour is in, once, whether as elite or as behavioural elite."""
    new = built(population, seed=seed)
    elites = [i.parents[0] for i in new if i.origin in (Origin.ELITE, Origin.BEHAVIOURAL_ELITE)]
    assert len(elites) == len(set(elites))
    for behaviour in BEHAVIOURS:
        performers = [e for e in ranked(population) if behaviour in e.labels.behaviours]
        assert not performers or performers[0].individual.id in elites


def test_resurrection() -> None:
    """A behaviour that died out comes back from the archive; one that lives does not."""
    population = people([outcome(fitness=float(i), pickups=3) for i in range(30)])
    archive = {
        "pickup": best("1.1", TREES[0], 1e6),
        "humanoid": best("2.5", TREES[3], 500.0),
    }
    new = built(population, archive=archive)
    resurrected = [(i.parents, i.tree) for i in new if i.origin is Origin.RESURRECTED]
    assert resurrected == [(("2.5",), TREES[3])]


def test_a_class_that_never_existed_cannot_be_resurrected() -> None:
    """What never was cannot come back."""
    population = people([outcome()] * 30)
    assert counted(built(population, archive={}))["resurrected"] == 0


def test_an_ancestor_comes_back_once() -> None:
    """The best of two behaviours that died out takes one slot, and a third behaviour the other."""
    population = people([outcome()] * 30)
    first, second = (
        best("2.5", TREES[3], 500.0),
        best("3.3", TREES[1], 400.0),
    )
    new = built(population, archive={"humanoid": first, "balanced": first, "charging": second})
    assert [i.parents for i in new if i.origin is Origin.RESURRECTED] == [("2.5",), ("3.3",)]


def test_remember() -> None:
    """The archive keeps the best of each behaviour, the first of equals."""
    first = people([outcome(fitness=5.0, pickups=1), outcome(fitness=5.0, pickups=1, charges=1)])
    archive = update_behaviour_archive({}, first, BEHAVIOURS, 0)
    assert {name: e.individual.id for name, (_, e) in archive.items()} == {
        "pickup": "4.0",
        "charging": "4.1",
    }
    later = people([outcome(fitness=4.0, pickups=1), outcome(fitness=6.0, charges=1)])
    updated = update_behaviour_archive(archive, later, BEHAVIOURS, 0)
    assert (updated["pickup"], updated["charging"][1].fitness) == (archive["pickup"], 6.0)
    assert archive["charging"][1].fitness == 5.0, "the archive given is not changed"


def test_remember_by_stage() -> None:
    """Another stage, another scale: a tree that shows a behaviour in a later one is remembered."""
    first = people([outcome(fitness=9.0, pickups=1), outcome(fitness=9.0, charges=1)])
    archive = update_behaviour_archive({}, first, BEHAVIOURS, 0)
    updated = update_behaviour_archive(
        archive, people([outcome(fitness=4.0, pickups=1)]), BEHAVIOURS, 1
    )
    assert (updated["pickup"][1].fitness, updated["charging"][1].fitness) == (4.0, 9.0)
    assert (
        update_behaviour_archive(updated, people([outcome(fitness=3.0, pickups=1)]), BEHAVIOURS, 1)
        == updated
    )


@examples(max_examples=60)
@given(population=populations(30), seed=SEEDS)
def test_supervisors_slot(population: tuple[Evaluated, ...], seed: int) -> None:
    """The supervisor's tree takes the first diversity slot, and nothing else changes."""
    tree = parse("sequence { SeekCharger ExecuteCharge MoveToHumanoid }")
    without, with_ = built(population, seed=seed), built(population, seed=seed, injected=tree)
    different = [(a, b) for a, b in zip(without, with_, strict=True) if a != b]
    assert len(different) == 1
    before, after = different[0]
    assert (before.origin, after.origin) == (Origin.RANDOM, Origin.INJECTED)
    assert (after.tree, after.parents, after.id) == (tree, (), before.id)
    assert with_.index(after) == min(
        i for i, one in enumerate(without) if one.origin is Origin.RANDOM
    )


def test_niche_protection() -> None:
    """Without it the class of the fittest supplies the parents; with it, 60 % at most or so."""
    strong = [outcome(fitness=1000.0 + i, pickups=3) for i in range(15)]
    weak = [outcome(fitness=float(i), interactions=3) for i in range(15)]
    population = people([*strong, *weak])
    rich = {e.individual.id for e in population if e.labels.specialist == "pickup"}

    def share(niche_share: float) -> float:
        table = composed().allocation.model_copy(update={"niche_share": niche_share})
        parents = [
            parent
            for seed in range(20)
            for i in built(population, seed=seed, allocation=table)
            if i.origin in (Origin.CROSSOVER, Origin.COPY)
            for parent in i.parents
        ]
        return sum(parent in rich for parent in parents) / len(parents)

    # Three entrants are all weak with chance 1/8; all strong, which cannot be helped, as often.
    assert share(1.0) == pytest.approx(7 / 8, abs=0.03)
    assert share(0.6) <= 0.63


def test_pick_parent() -> None:
    """The winner, until its class has given its share; then the best of classes with room."""
    best, other, third, idle = people(
        [
            outcome(fitness=4.0, pickups=1),
            outcome(fitness=3.0, pickups=1),
            outcome(fitness=1.0, interactions=1),
            outcome(fitness=2.0),
        ]
    )

    def pick(*present: Evaluated, count: int) -> Evaluated:
        rng = np.random.default_rng(0)
        return pick_parent(rng, tournament, present, Counter(pickup=count), most=6, entrants=100)

    assert pick(best, other, third, idle, count=5) is best
    assert pick(best, other, third, idle, count=6) is third
    assert pick(best, other, idle, count=6) is best  # patrol-only is no niche to protect


@examples(max_examples=30)
@given(population=populations(30), seed=SEEDS)
def test_names_and_parents(population: tuple[Evaluated, ...], seed: int) -> None:
    """Ids are `<generation>.<slot>`; parents are ids of the population before."""
    new = built(population, seed=seed)
    assert [i.id for i in new] == [f"5.{slot}" for slot in range(30)]
    before = {e.individual.id for e in population}
    expected = {Origin.CROSSOVER: 2, Origin.COPY: 1, Origin.ELITE: 1, Origin.BEHAVIOURAL_ELITE: 1}
    for i in new:
        assert len(i.parents) == expected.get(i.origin, 0)
        assert set(i.parents) <= before


def test_slots_are_filled_in_order() -> None:
    """Elites, behavioural elites, resurrected, diversity, tournament: the order of section 2.3."""
    outcomes = [outcome(fitness=float(i), pickups=i % 3, charges=i % 2) for i in range(30)]
    archive = {"humanoid": best("1.0", TREES[3], 9.0)}
    rows = [
        "elite", "behavioural_elite", "resurrected", "injected", "random", "crossover", "copy",
    ]  # fmt: skip
    new = built(people(outcomes), archive=archive, injected=TREES[1])
    places = [min(rows.index(i.origin), rows.index("crossover")) for i in new]
    assert all(a <= b for a, b in pairwise(places))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"diversity": (3, 2)}, "expected the lower number first"),
        ({"diversity": (0, 2)}, "greater than or equal to 1"),
        ({"tournament_children": (22, 25)}, "slots that fit into 30"),
        ({"diversity_targets": (0.3, 0.5)}, "diversity_targets"),
        ({"niche_share": 0.0}, "niche_share"),
    ],
)
def test_tables_that_cannot_be(change: dict[str, object], message: str) -> None:
    """A table whose slots cannot be filled is refused."""
    with pytest.raises(ValidationError, match=message):
        Allocation.model_validate({**composed().allocation.model_dump(), **change})
