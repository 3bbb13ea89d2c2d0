"""From an episode's events to an individual's outcome."""

from __future__ import annotations

import pytest

from islandgp.island.episode import Ending, Episode
from islandgp.island.journal import Event
from islandgp.scoring.outcome import combine
from islandgp.scoring.outcome import outcome as outcome_of
from tests.composed import composed
from tests.made import outcome


def test_outcome_counts_events() -> None:
    """Pickups, interactions, deliveries and charges are counted, items are added up."""
    episode = Episode(
        events=(
            (1, Event.PICKUP, 1),
            (2, Event.PICKUP, 1),
            (3, Event.INTERACTION, 7),
            (4, Event.DELIVERY, 9),
            (5, Event.EMPTY_DELIVERY, 1),
            (6, Event.CHARGE, 30.0),
            (7, Event.COLLISION, 1),
            (10, Event.LEFTOVER, 100),
        ),
        steps=10,
        ending=Ending.STAGNATION,
        fitness=0.0,
        battery=12.5,
        distance=80.0,
        inactive=0.4,
        laps=2,
        ticks=10,
    )
    settings = composed()
    found = outcome_of(
        episode, settings.rewards, settings.curriculum.multipliers(0), seconds_per_step=0.1
    )
    assert (found.pickups, found.interactions, found.deliveries) == (2, 1, 1)
    assert (found.charges, found.collisions) == (1, 1)
    assert (found.gathered, found.delivered) == (9, 9)
    assert (found.battery, found.distance, found.inactive, found.laps) == (12.5, 80, 0.4, 2)
    assert (found.seconds, found.endings) == (1.0, ("stagnation",))
    # 2 * 600 + 1.5 * 675 + (370 - 150) + 200 - 500 - 0.8 * 2000
    assert found.fitness == sum(found.components) == pytest.approx(532.5)


def test_combine_one() -> None:
    """One episode's outcome is itself."""
    one = outcome(fitness=3.0)
    assert combine([one]) is one


def test_combine_is_the_mean() -> None:
    """Several episodes give the mean of each number, and all endings."""
    found = combine(
        [
            outcome(fitness=10.0, components=(1.0,) * 8, pickups=1.0, endings=("time",)),
            outcome(fitness=30.0, components=(4.0,) * 8, pickups=0.0, endings=("shutdown",)),
        ]
    )
    assert (found.fitness, found.pickups, found.battery) == (20, 0.5, 50)
    assert found.components == (2.5,) * 8
    assert found.endings == ("time", "shutdown")
