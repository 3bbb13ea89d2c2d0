"""Epsilon-lexicase selection: DEAP's for comparison, cases by hand, and the cases' sources."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.errors import ConfigError
from islandgp.search.lexicase import passing, selected
from islandgp.seeding import Streams
from tests.profiles import examples
from tests.search.searches import NO_ADVICE, evaluated, search_and_plan

TABLES = st.tuples(st.integers(1, 9), st.integers(1, 5)).flatmap(
    lambda shape: st.lists(
        st.lists(st.integers(-4, 4), min_size=shape[1], max_size=shape[1]),
        min_size=shape[0],
        max_size=shape[0],
    )
)


def of_deap(points: list[list[float]], order: list[int], monkeypatch: pytest.MonkeyPatch) -> Any:
    """The rows that DEAP's automatic epsilon-lexicase chooses from, with the cases in an order."""
    pytest.importorskip("deap", reason="deap is not installed: pip install 'islandgp[bench]'")
    from deap import base
    from deap.tools import selection

    class Fitness(base.Fitness):  # type: ignore[misc] # deap ships no types
        weights = (1.0,) * len(order)

    class Row:
        def __init__(self, number: int) -> None:
            self.number = number
            self.fitness = Fitness(points[number])

    class Drawn:
        """In place of the module `random`: the given order, and all that are left."""

        @staticmethod
        def shuffle(cases: list[int]) -> None:
            cases[:] = order

        @staticmethod
        def choice(rows: list[Row]) -> list[int]:
            return [row.number for row in rows]

    monkeypatch.setattr(selection, "random", Drawn)
    [candidates] = selection.selAutomaticEpsilonLexicase([Row(k) for k in range(len(points))], 1)
    return candidates


@examples(max_examples=200)
@given(points=TABLES, data=st.data())
def test_the_same_as_deap(points: list[list[int]], data: st.DataObject) -> None:
    """The individuals that are left after all cases are those of DEAP's selection."""
    order = data.draw(st.permutations(range(len(points[0]))))
    with pytest.MonkeyPatch.context() as monkeypatch:
        expected = of_deap([[float(x) for x in row] for row in points], order, monkeypatch)
    assert passing(np.array(points, dtype=float), order).tolist() == expected


def test_by_hand() -> None:
    """Epsilon is the median absolute deviation of those that are left."""
    points = np.array([[10.0, 0.0], [9.0, 5.0], [1.0, 9.0], [0.0, 1.0]])
    # Case 0: median 5, deviations 5, 4, 4, 5: 10 - 4.5 keeps the first two; of these case 1
    # has median 2.5 and deviation 2.5: 5 - 2.5 keeps the second.
    assert passing(points, [0, 1]).tolist() == [1]
    # Case 1: median 3, deviations 3, 2, 6, 2: 9 - 2.5 keeps the third alone.
    assert passing(points, [1, 0]).tolist() == [2]


def test_specialists_are_selected() -> None:
    """Who is the best in one case alone has children; who is the best in none has none."""
    points = np.array([[9.0, 0, 0], [0, 9.0, 0], [0, 0, 9.0], [1.0, 1, 1], [-1, -1, -1]])
    rng = np.random.default_rng(0)
    parents = Counter(selected(rng, points) for _ in range(300))
    assert {0, 1, 2} <= set(parents)
    assert 4 not in parents


@pytest.mark.parametrize(
    ("cases", "expected"), [("components", (1.0, 2.0)), ("episodes", (5.0, 1.0, 7.0))]
)
def test_cases(cases: str, expected: tuple[float, ...]) -> None:
    """The terms of the fitness, or the fitness of each episode."""
    search, _ = search_and_plan("lexicase", f"search.policy.cases={cases}", "gp.episodes=3")
    e = evaluated("0.0", components={"garbage": 1.0, "battery": 2.0}, episodes=(5.0, 1.0, 7.0))
    points = search.cases(e)
    assert points[: len(expected)] == expected
    if cases == "components":
        assert set(points[2:]) == {0.0}


def test_one_episode_is_no_choice_of_cases() -> None:
    """Lexicase selection over a single case would be a choice of the best alone."""
    with pytest.raises(ConfigError, match=r"^search\.policy\.cases: expected several episodes"):
        search_and_plan("lexicase", "search.policy.cases=episodes", "gp.episodes=1")


def test_the_fittest_are_evaluated_again() -> None:
    """In the next generation's worlds, the best first."""
    search, _ = search_and_plan("lexicase", "allocation.reevaluated=0.25")
    population = [evaluated(f"0.{k}", float(k % 5)) for k in range(12)]
    state = search.tell(search.start(), population, NO_ADVICE)
    new = tuple(search.ask(state, Streams(1)))
    assert [i.parents for i in new if i.origin == "elite"] == [("0.4",), ("0.9",), ("0.3",)]
