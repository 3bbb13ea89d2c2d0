"""MAP-Elites and its grid: cells by hand, the best of each, and elites that were only lucky."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.search.descriptor import cell, point
from islandgp.seeding import Streams
from tests.samples import outcome
from tests.search.searches import NO_ADVICE, evaluated, generations, search_and_plan

TREES = ("PatrolWaypoint", "SeekCharger", "MoveToGarbage", "PickupGarbage", "MoveToHumanoid")


def scaled(value: float) -> float:
    """A counter's value in a descriptor."""
    return point(["pickups"], outcome(pickups=value))[0]


@pytest.mark.parametrize(
    ("values", "bins"),
    [
        # 0 | 1 | 2, 3 | 4 to 7 | 8 to 15 | the rest
        ((0, 0.2, 1, 1.5, 3, 4, 7, 8, 15, 16, 1e9), (0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5)),
        ((-1, -3, -1e300), (-1, -2, -5)),
    ],
)
def test_bins(values: tuple[float, ...], bins: tuple[int, ...]) -> None:
    """Bin 0 holds 0 alone; then each is twice as wide as before."""
    assert tuple(cell((scaled(value),), 5)[0] for value in values) == bins


@given(value=st.floats(-1e12, 1e12))
def test_places_keep_order_and_sign(value: float) -> None:
    """A larger value has a larger place, and below 0 the place is the mirror image."""
    assert scaled(-value) == -scaled(value)
    assert scaled(value + abs(value) / 2 + 1) > scaled(value)
    assert abs(cell((scaled(value),), 7)[0]) <= 7


def test_behaviours_are_the_descriptor_by_default() -> None:
    """Each behaviour has its counter."""
    search, plan = search_and_plan("map_elites")
    counters = search.settings.counters(plan.classes)
    assert counters == ("pickups", "interactions", "charges", "deliveries")
    assert point(counters, outcome(pickups=3, deliveries=1)) == (2.0, 0.0, 0.0, 1.0)


def test_a_cell_keeps_its_best() -> None:
    """Trees compete with those that do the same; a cell keeps `depth` of them."""
    search, _ = search_and_plan("map_elites", "search.policy.depth=2")
    population = [
        evaluated("0.0", 10, tree=TREES[0], pickups=2),
        evaluated("0.1", 30, tree=TREES[1], pickups=3),
        evaluated("0.2", 20, tree=TREES[2], pickups=2),
        evaluated("0.3", -5, tree=TREES[3], charges=1),
    ]
    state = search.tell(search.start(), population, NO_ADVICE)
    cells = search.cells(state.memory.occupants)
    assert {key: [o.id for o in occupants] for key, occupants in cells.items()} == {
        (2, 0, 0, 0): ["0.1", "0.2"],
        (0, 0, 1, 0): ["0.3"],
    }


def test_an_elite_is_worth_the_mean_of_its_episodes() -> None:
    """A lucky elite gives its place back to the one behind it."""
    search, _ = search_and_plan("map_elites", "search.policy.depth=2")
    first = [
        evaluated("0.0", 100, tree=TREES[0], pickups=2),
        evaluated("0.1", 60, tree=TREES[1], pickups=2),
    ]
    state = search.tell(search.start(), first, NO_ADVICE)
    second = [evaluated("1.0", -50, tree=TREES[0], pickups=4)]
    state = search.tell(state, second, NO_ADVICE)
    best, behind = state.memory.occupants
    assert (best.id, len(best.fitness), best.means[" fitness"]) == ("0.1", 1, 60)
    assert (behind.id, len(behind.fitness), behind.means[" fitness"]) == ("1.0", 2, 25)
    assert behind.means[" axis 0"] == pytest.approx((scaled(2) + scaled(4)) / 2)


def test_elites_are_evaluated_again() -> None:
    """Those with the fewest episodes first, then the fittest; no more than their share of slots."""
    search, _ = search_and_plan("map_elites", "allocation.reevaluated=0.25")
    population = [
        evaluated("0.0", 10, tree=TREES[0], pickups=1),
        evaluated("0.1", 30, tree=TREES[1], charges=1),
        evaluated("0.2", 20, tree=TREES[2], deliveries=1),
        evaluated("0.3", 40, tree=TREES[3], interactions=1),
    ]
    state = search.tell(search.start(), population, NO_ADVICE)
    state = search.tell(state, [evaluated("1.0", 40, tree=TREES[3], interactions=1)], NO_ADVICE)
    new = tuple(search.ask(state, Streams(1)))
    assert [i.parents for i in new if i.origin == "elite"] == [("0.1",), ("0.2",), ("0.0",)]


def test_parents_come_from_all_cells() -> None:
    """Uniformly over cells, so that the weakest behaviour has as many children as the best."""
    search, _ = search_and_plan("map_elites", "gp.population=200", "allocation.reevaluated=0")
    population = [
        evaluated("0.0", 1000, tree=TREES[0], pickups=1),
        evaluated("0.1", -1000, tree=TREES[1], charges=1),
    ]
    state = search.tell(search.start(), population, NO_ADVICE)
    mothers = Counter(i.parents[0] for i in search.ask(state, Streams(1)))
    assert mothers["0.0"] + mothers["0.1"] == 200
    assert 70 < mothers["0.0"] < 130


def test_the_grid_is_bounded() -> None:
    """No more cells than bins allow, and no more trees in one than `depth`."""
    search, plan = search_and_plan("map_elites", "search.policy.bins=1", "search.policy.depth=1")
    _, state = generations(search, plan, 7)
    assert 1 < len(state.memory.occupants) <= 2**4
