"""The hill climber replaces its parent by a better child; random search inherits nothing."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.seeding import Streams
from tests.search.searches import NO_ADVICE, evaluated, generations, search_and_plan


def test_a_better_child_takes_the_parent_s_place() -> None:
    """Of equals the parent stays; it is evaluated again with the id of its new individual."""
    search, _ = search_and_plan("hill")
    state = search.tell(
        search.start(), [evaluated("0.0", 1), evaluated("0.1", 7, tree="SeekCharger")], NO_ADVICE
    )
    assert search.plan_next(state).reevaluated[0].id == "0.1"
    new = tuple(search.ask(state, Streams(3)))
    assert (new[0].id, new[0].tree, new[0].parents) == ("1.0", parse("SeekCharger"), ("0.1",))
    assert {i.parents for i in new} == {("0.1",)}
    equals = [evaluated("1.0", 3), evaluated("1.1", 3, tree="PatrolWaypoint"), evaluated("1.2", 2)]
    after = search.tell(state, equals, NO_ADVICE)
    assert search.plan_next(after).reevaluated[0].id == "1.0"
    better = [evaluated("1.0", 3), evaluated("1.1", 3.5, tree="MoveToGarbage"), evaluated("1.2", 3)]
    after = search.tell(state, better, NO_ADVICE)
    assert search.plan_next(after).reevaluated[0].id == "1.1"


def test_the_climber_never_falls_in_the_same_worlds() -> None:
    """Each parent was the best of its generation."""
    search, plan = search_and_plan("hill")
    populations, state = generations(search, plan, 7)
    for before, after in pairwise(populations):
        best = max(before, key=lambda e: e.fitness)
        assert after[0].individual.parents == (best.individual.id,)
    assert state.generation == 7


def test_a_child_differs_from_its_parent_if_it_can() -> None:
    """A tree is not evaluated twice in the same worlds."""
    search, plan = search_and_plan("hill")
    populations, _ = generations(search, plan, 7)
    for population in populations:
        texts = Counter(to_text(e.individual.tree) for e in population)
        assert set(texts.values()) == {1}


def test_random_search_differs_from_racing_by_inheritance_alone() -> None:
    """Racing's first population is the same, and neither evaluates a tree of its own again."""
    search, plan = search_and_plan("random")
    racing, _ = search_and_plan("racing", "search.policy.library=0")
    streams = Streams(5)
    first = tuple(search.ask(search.start(), streams))
    assert first == tuple(racing.ask(racing.start(), streams))
    populations, _ = generations(search, plan, 7)
    individuals = [e.individual for population in populations for e in population]
    assert len({i.tree for i in individuals}) == len(individuals)
    assert {(i.origin, i.parents, i.mutation) for i in individuals} == {("random", (), "")}


@pytest.mark.parametrize(("share", "least", "most"), [(0, 0, 0), (0.5, 30, 90), (1, 120, 120)])
def test_random_priority_lists(share: float, least: int, most: int) -> None:
    """A share of them: selectors of guarded branches with an action behind them."""
    search, _ = search_and_plan(
        "random_paper",
        *(f"search.policy.lists={share}", "gp.population=120", "gp.trees.kinds.selector=0"),
    )
    trees = [i.tree for i in search.ask(search.start(), Streams(1))]
    assert least <= sum(tree.kind == "selector" for tree in trees) <= most
