"""From several episodes to an individual's outcome."""

from __future__ import annotations

import pytest

from islandgp.evolution.generation import mean_outcome
from tests.samples import NOTHING, outcome


def test_fitness_is_the_sum_of_the_components() -> None:
    """Eq. (1)."""
    assert NOTHING.fitness == 0
    assert outcome(components={"garbage": 3.5, "idle": -1.0}).fitness == 2.5


def test_measure() -> None:
    """A counter or the fitness by name; any other name is an error, a component's too."""
    result = outcome(7.0, pickups=2)
    assert (result.measure("fitness"), result.measure("pickups")) == (7, 2)
    with pytest.raises(KeyError):
        result.measure("garbage")


def test_combine_one() -> None:
    """One episode's outcome is itself."""
    one = outcome(fitness=3.0)
    assert mean_outcome([one]) is one


def test_combine_is_the_mean() -> None:
    """Several episodes give the mean of each number, and all endings."""
    mean = mean_outcome(
        [
            outcome(components={"garbage": 6.0, "idle": 4.0}, pickups=1, seconds=420),
            outcome(components={"garbage": 31.0, "idle": -1.0}, seconds=60, endings=("shutdown",)),
        ]
    )
    assert (mean.fitness, mean.seconds) == (20, 240)
    assert (mean.counters["pickups"], mean.counters["battery"]) == (0.5, 50)
    assert (mean.components["garbage"], mean.components["idle"]) == (18.5, 1.5)
    assert mean.components.keys() == NOTHING.components.keys()
    assert mean.endings == ("time", "shutdown")
