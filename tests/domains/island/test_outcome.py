"""From an episode's events to its outcome: counts, and points by component."""

from __future__ import annotations

import pytest

from islandgp.bt.core.language import parse
from islandgp.domain.rewards import worth
from islandgp.domains.island.domain import Island
from islandgp.domains.island.events import EVENTS
from islandgp.domains.island.state import State
from islandgp.domains.island.vocabulary import SCHEMA
from tests.composed import composed

EVENTS_LOGGED = (
    ("pickup", 1),
    ("pickup", 1),
    ("interaction", 7),
    ("delivery", 9),
    ("empty_delivery", 1),
    ("charge", 30.0),
    ("collision", 1),
    ("leftover", 100),
)


def test_outcome_counts_events(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pickups, interactions, deliveries and charges are counted, items are added up."""
    settings = composed()
    island = Island.make(settings.world, settings.rewards)
    end = State(settings.world, 0, worth(settings.rewards, settings.curriculum.multipliers(0)))
    monkeypatch.setattr("islandgp.domains.island.episode.run_episode", lambda *_, **__: end)
    assert island.run_episode(None, 0, {}).components == dict.fromkeys(SCHEMA.components, 0)  # type: ignore[arg-type]
    for event, amount in EVENTS_LOGGED:
        end.log(event, amount)
    fields = {"step": 10, "last_action": 6, "laps": 2, "battery": 12_500_000}
    for name, value in {**fields, "odometer": round(80 / end.stride)}.items():
        end.record[name] = value
    outcome = island.run_episode(None, 0, settings.curriculum.multipliers(0))  # type: ignore[arg-type]
    assert outcome.counters == {
        "pickups": 2,
        "interactions": 1,
        "deliveries": 1,
        "charges": 1,
        "gathered": 9,
        "delivered": 9,
        "collisions": 1,
        "distance": 80,
        "inactive": 0.4,
        "laps": 2,
        "battery": 12.5,
    }
    assert (outcome.seconds, outcome.endings) == (1.0, ("stagnation",))
    assert outcome.components == pytest.approx(
        {
            "garbage": 1200,  # 2 * 2 * 300
            "battery": 200,
            "humanoid": 1012.5,  # 1.5 * (360 + 7 * 45)
            "delivery": 220,  # 100 + 9 * 30 - 150
            "leftover": -1600,  # 0.8 * 100 * -20
            "patrol": 0,
            "idle": 0,
            "collision": -500,
        }
    )
    assert outcome.fitness == pytest.approx(532.5) == end.event_log.fitness


def test_outcomes_are_in_the_order_of_the_schema() -> None:
    """Records and tables show components and counters as the schema declares them."""
    settings = composed("world.episode.length=1")
    outcome = settings.make_domain().run_episode(parse("PatrolWaypoint"), 3, {})
    assert list(outcome.components) == list(SCHEMA.components)
    assert list(outcome.counters) == list(SCHEMA.counters)


def test_every_event_has_a_row_of_table_3() -> None:
    """No event is worth nothing by omission, and the schema declares what the island logs."""
    assert set(composed().rewards.events) == set(EVENTS) == set(SCHEMA.events)


def test_counters_of_the_event_log_are_scored() -> None:
    """Fitness while an episode runs, by which it may end, is the outcome's."""
    value = worth(composed().rewards, {})
    assert value("delivery", 4) == value("delivery", 4) == ("delivery", 220)
