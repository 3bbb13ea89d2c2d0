"""NSGA-II: DEAP's for comparison, fronts by hand, and the objectives of configuration."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.search.nsga2 import crowded_order, crowding, ranks
from islandgp.seeding import Streams
from tests.profiles import examples
from tests.search.searches import NO_ADVICE, evaluated, search_and_plan

ANY_POINTS = st.tuples(st.integers(1, 14), st.integers(1, 4)).flatmap(
    lambda shape: st.lists(
        st.lists(st.integers(-3, 3), min_size=shape[1], max_size=shape[1]),
        min_size=shape[0],
        max_size=shape[0],
    )
)


def rows_of_deap(points: np.ndarray[Any, Any]) -> list[Any]:
    """The points as DEAP's individuals, to be maximised."""
    pytest.importorskip("deap", reason="deap is not installed: pip install 'islandgp[bench]'")
    from deap import base

    class Fitness(base.Fitness):  # type: ignore[misc] # deap ships no types
        weights = (1.0,) * points.shape[1]

    class Row:
        def __init__(self, number: int) -> None:
            self.number = number
            self.fitness = Fitness(points[number].tolist())

    return [Row(k) for k in range(len(points))]


@examples(max_examples=150)
@given(table=ANY_POINTS)
def test_fronts_as_deap_has_them(table: list[list[int]]) -> None:
    """Also with equal points and equal values."""
    points = np.array(table, dtype=float)
    rows = rows_of_deap(points)
    from deap.tools import sortNondominated

    fronts = sortNondominated(rows, len(rows))
    expected = {row.number: r for r, front in enumerate(fronts) for row in front}
    assert ranks(points).tolist() == [expected[k] for k in range(len(points))]


@pytest.mark.slow
@examples(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 20), objectives=st.integers(2, 5))
def test_crowding_and_selection_as_deap_has_them(seed: int, n: int, objectives: int) -> None:
    """Without ties the same individuals survive, for each number of survivors."""
    points = np.random.default_rng(seed).random((n, objectives))
    rows = rows_of_deap(points)
    from deap.tools import selNSGA2, sortNondominated
    from deap.tools.emo import assignCrowdingDist

    for front in sortNondominated(rows, n):
        assignCrowdingDist(front)
        distances = crowding(points[[row.number for row in front]])
        # DEAP divides by the number of objectives.
        theirs = [row.fitness.crowding_dist * objectives for row in front]
        assert distances.tolist() == pytest.approx(theirs)
    for most in range(1, n + 1):
        theirs = {row.number for row in selNSGA2(rows, most)}
        ours = crowded_order(points)[:most]
        # At the edge of a front two points may be equally crowded: both with inf.
        assert {_key(points, k) for k in ours} == {_key(points, k) for k in theirs}


def _key(points: np.ndarray[Any, Any], k: int) -> tuple[float, float]:
    rank = ranks(points)
    front = np.flatnonzero(rank == rank[k])
    return float(rank[k]), float(crowding(points[front])[list(front).index(k)])


def test_by_hand() -> None:
    """Five points on two fronts; the ends of a front come before its middle."""
    points = np.array([[1.0, 1.0], [3.0, 0.0], [0.0, 3.0], [2.0, 2.0], [0.0, 0.0]])
    assert ranks(points).tolist() == [1, 0, 0, 0, 2]
    assert crowding(points[[1, 2, 3]]).tolist() == [inf, inf, 2.0]
    assert crowded_order(points) == [1, 2, 3, 0, 4]
    assert crowding(np.array([[1.0], [1.0], [1.0]])).tolist() == [inf, 0.0, inf]


def test_objectives() -> None:
    """The fitness, the nodes and counters, each maximised or minimised."""
    search, _ = search_and_plan(
        "nsga2",
        "search.policy.objectives=[-nodes,pickups,-distance]",
        "allocation.reevaluated=0.4",
    )
    population = [
        evaluated("0.0", 9.0, tree="sequence { PatrolWaypoint }", pickups=1, distance=5),
        evaluated("0.1", 0.0, tree="PatrolWaypoint", pickups=1, distance=5),
        evaluated("0.2", 0.0, tree="sequence { SeekCharger }", pickups=2, distance=9),
        evaluated("0.3", 0.0, tree="sequence { SeekCharger }", pickups=2, distance=8),
        evaluated("0.4", 99.0, tree="sequence { SeekCharger }", pickups=0, distance=99),
    ]
    state = search.tell(search.start(), population, NO_ADVICE)
    assert {parent.id for parent in search.plan_next(state).reevaluated} == {"0.1", "0.3"}


def test_by_default_the_fitness_and_the_behaviours() -> None:
    """A specialist that earns less survives beside the fittest."""
    search, _ = search_and_plan("nsga2")
    assert search.objectives == ("fitness", "pickups", "interactions", "charges", "deliveries")
    population = [
        evaluated("0.0", 900.0, pickups=5),
        evaluated("0.1", -50.0, charges=1),
        *(evaluated(f"0.{k}", float(-k)) for k in range(2, 8)),
    ]
    state = search.tell(search.start(), population, NO_ADVICE)
    assert {"0.0", "0.1"} <= {parent.id for parent in search.plan_next(state).reevaluated}
    assert len(search.plan_next(state).reevaluated) == 4


def test_survivors_meet_the_worlds_of_their_children() -> None:
    """Half of the generation are survivors, the other half children of them."""
    search, _ = search_and_plan("nsga2")
    population = [evaluated(f"0.{k}", float(k)) for k in range(12)]
    state = search.tell(search.start(), population, NO_ADVICE)
    new = tuple(search.ask(state, Streams(1)))
    assert [i.origin for i in new[:6]] == ["elite"] * 6
    survivors = {parent.id for parent in search.plan_next(state).reevaluated}
    assert {parent for i in new for parent in i.parents} <= survivors
    assert all(i.origin in ("copy", "crossover") for i in new[6:])
