"""The hill climber replaces its parent by a better child; random search inherits nothing."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.gp.random_trees import random_tree
from islandgp.seeding import Stream, Streams
from tests.search.searches import NO_ADVICE, evaluated, generations, search_and_plan


def test_a_better_child_takes_the_parent_s_place() -> None:
    """Of equals the parent stays; it is evaluated again with the id of its new individual."""
    search, _ = search_and_plan("hill")
    state = search.tell(
        search.start(), [evaluated("0.0", 1), evaluated("0.1", 7, tree="SeekCharger")], NO_ADVICE
    )
    assert state.memory.id == "0.1"
    new = search.ask(state, Streams(3))
    assert (new[0].id, new[0].tree, new[0].parents) == ("1.0", parse("SeekCharger"), ("0.1",))
    assert {i.parents for i in new} == {("0.1",)}
    equals = [evaluated("1.0", 3), evaluated("1.1", 3, tree="PatrolWaypoint"), evaluated("1.2", 2)]
    assert search.tell(state, equals, NO_ADVICE).memory.id == "1.0"
    better = [evaluated("1.0", 3), evaluated("1.1", 3.5, tree="MoveToGarbage"), evaluated("1.2", 3)]
    assert search.tell(state, better, NO_ADVICE).memory.id == "1.1"


def test_the_climber_never_falls_in_the_same_worlds() -> None:
    """Each parent was the best of its generation."""
    search, plan = search_and_plan("hill")
    populations, state = generations(search, plan, 7)
    for before, after in pairwise(populations):
        best = max(before, key=lambda e: e.fitness)
        assert after[0].individual.parents == (best.individual.id,)
    assert state.generation == 7


def test_no_child_equals_its_parent_where_others_can_be() -> None:
    """A tree is not evaluated twice in the same worlds."""
    search, plan = search_and_plan("hill")
    populations, _ = generations(search, plan, 7)
    for population in populations:
        texts = Counter(to_text(e.individual.tree) for e in population)
        assert set(texts.values()) == {1}


def test_random_search_draws_the_paper_s_first_population() -> None:
    """From the same streams, so that both start alike; later ones are as its random slots."""
    search, plan = search_and_plan("random")
    paper, _ = search_and_plan("paper")
    streams = Streams(5)
    first = search.ask(search.start(), streams)
    assert [i.tree for i in first] == [i.tree for i in paper.ask(paper.start(), streams)]
    later = search.ask(replace(search.start(), generation=3), streams)
    expected = [
        random_tree(streams(Stream.DIVERSITY, generation=3, slot=slot), plan.space)
        for slot in range(12)
    ]
    assert [i.tree for i in later] == expected
    assert {(i.origin, i.parents, i.mutation) for i in later} == {("random", (), "")}


@pytest.mark.parametrize(("share", "least", "most"), [(0, 0, 0), (0.5, 30, 90), (1, 120, 120)])
def test_random_priority_lists(share: float, least: int, most: int) -> None:
    """A share of them: selectors of guarded branches with an action behind them."""
    search, _ = search_and_plan(
        "random", f"search.policy.lists={share}", "gp.population=120", "gp.trees.kinds.selector=0"
    )
    trees = [i.tree for i in search.ask(search.start(), Streams(1))]
    assert least <= sum(tree.kind == "selector" for tree in trees) <= most
