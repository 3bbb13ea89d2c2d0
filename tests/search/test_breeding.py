"""Children of the searches that breed: their origins and parents."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

from islandgp.bt.core.language import parse
from islandgp.gp.population import Advice, Origin, Proposal
from islandgp.search.breeding import Breeding, Parent, new_child
from islandgp.search.racing import RacingSettings
from tests.composed import composed, composed_plan
from tests.search.searches import generations, search_and_plan

MOTHER = parse("selector { when batteryLevel < 20 { SeekCharger } PatrolWaypoint }")
FATHER = parse(
    "selector { when foundGarbage { PickupGarbage } when batteryLevel < 9 { SeekCharger } }"
)


def children(father: Parent, crossover_rate: float) -> Iterator[Proposal]:
    """A hundred children of `search=racing`."""
    policy = composed("search=racing").search.settings()
    assert isinstance(policy, RacingSettings)
    values = {**policy.breeding.model_dump(), "crossover_rate": crossover_rate}
    breeding, space = Breeding.model_validate(values), composed_plan("search=racing").space
    for seed in range(100):
        rng = np.random.default_rng(seed)
        yield new_child(rng, Parent("3.1", MOTHER), [father], space, breeding)


def test_a_child_of_two_individuals_names_both() -> None:
    """It is a crossover; where the crossover changes nothing, it is a mutated copy."""
    offspring = list(children(Parent("3.2", FATHER), crossover_rate=1.0))
    assert {(each.origin, each.parents) for each in offspring} <= {
        (Origin.CROSSOVER, ("3.1", "3.2")),
        (Origin.COPY, ("3.1",)),
    }
    assert sum(each.origin == Origin.CROSSOVER for each in offspring) > 80


def test_a_crossover_with_a_tree_of_the_library_has_one_parent() -> None:
    """A tree of the library is no individual, so it has no id."""
    offspring = list(children(Parent("", FATHER), crossover_rate=1.0))
    assert {each.parents for each in offspring} == {("3.1",)}
    assert sum(each.origin == Origin.CROSSOVER for each in offspring) > 80


def test_without_crossover_every_child_is_a_mutated_copy() -> None:
    """At least one mutation was tried for each."""
    offspring = list(children(Parent("3.2", FATHER), crossover_rate=0.0))
    assert {(each.origin, each.parents) for each in offspring} == {(Origin.COPY, ("3.1",))}
    assert all(each.mutation or each.tree == MOTHER for each in offspring)


@pytest.mark.parametrize("name", ["racing", "hill", "lexicase", "map_elites", "novelty", "nsga2"])
def test_slots(name: str) -> None:
    """Of 12: the supervisor's tree with two mutants, and a quarter of random trees."""
    words = ["supervisor=expert", "allocation.injected=3", "allocation.random=0.25"]
    search, plan = search_and_plan(name, *words)
    populations, _ = generations(search, plan, 5, advice=Advice(rate=0.0, tree=MOTHER))
    slots = [e.individual for e in populations[4]]
    assert Counter(i.origin for i in slots)[Origin.RANDOM] == 3
    mine = [i for i in slots if i.origin == Origin.INJECTED]
    assert [i.parents for i in mine] == [(), (), ()]
    assert mine[0].tree == MOTHER
    assert [bool(i.mutation) for i in mine] == [False, True, True]


def test_new_trees_are_new() -> None:
    """In a small space of trees, too: no child has a tree that was evaluated before."""
    small = ("gp.max_nodes=5", "gp.max_depth=3", "gp.trees.children=[2,2]", "gp.trees.depth=[2,2]")
    populations, _ = generations(*search_and_plan("racing", *small), 6)
    individuals = [e.individual for population in populations for e in population]
    new = [i.tree for i in individuals if i.origin not in (Origin.ELITE, Origin.INJECTED)]
    assert len(new) > 50
    assert len(set(new)) == len(new)
