"""Table 3 under Table 2, Eq. (1) and (2): values worked by hand."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from islandgp.island.journal import Event
from islandgp.scoring.rewards import (
    TABLE_3,
    Component,
    Multipliers,
    Rewards,
    award,
    charge_points,
    components,
    multiplier,
)
from tests.composed import composed

PLAIN = Multipliers(garbage=1, battery=1, humanoid=1, delivery=1, leftover=1)


def rewards(**changes: object) -> Rewards:
    """The paper's rewards, changed."""
    return Rewards.model_validate({**composed().rewards.model_dump(), **changes})


@pytest.mark.parametrize(
    ("event", "amount", "component", "stages"),
    [
        # amount: what the event counts; stages: points in stages 1, 2, 3, 4
        (Event.PICKUP, 1, Component.GARBAGE, (600, 540, 480, 450)),  # 200 + 100
        (Event.INTERACTION, 5, Component.HUMANOID, (877.5, 877.5, 1053, 1170)),  # 360 + 5 * 45
        (Event.INTERACTION, 10, Component.HUMANOID, (1215, 1215, 1458, 1620)),  # 360 + 450
        (Event.CHARGE, 14.9, Component.BATTERY, (800, 2000, 1600, 1440)),
        (Event.CHARGE, 24.9, Component.BATTERY, (400, 1000, 800, 720)),
        (Event.CHARGE, 44.9, Component.BATTERY, (200, 500, 400, 360)),
        (Event.CHARGE, 45, Component.BATTERY, (65, 162.5, 130, 117)),  # 20 + 45
        (Event.CHARGE, 90, Component.BATTERY, (110, 275, 220, 198)),  # 20 + 90
        (Event.SHUTDOWN, 1, Component.BATTERY, (-3000, -7500, -6000, -5400)),
        (Event.DELIVERY, 10, Component.DELIVERY, (400, 480, 1000, 800)),  # 100 + 10 * 30
        (Event.DELIVERY, 30, Component.DELIVERY, (1000, 1200, 2500, 2000)),
        (Event.EMPTY_DELIVERY, 1, Component.DELIVERY, (-150, -180, -375, -300)),
        (Event.PATROL, 1, Component.PATROL, (13, 13, 13, 13)),
        (Event.DISCOVERY, 3, Component.PATROL, (30, 30, 30, 30)),
        (Event.IDLE, 1, Component.IDLE, (0, 0, 0, 0)),
        (Event.IDLE, 20, Component.IDLE, (0, 0, 0, 0)),  # the 20th second is still free
        (Event.IDLE, 21, Component.IDLE, (-10, -10, -10, -10)),
        (Event.COLLISION, 1, Component.COLLISION, (-500, -500, -500, -500)),
        (Event.LEFTOVER, 120, Component.LEFTOVER, (-1920, -2400, -3600, -4800)),  # 120 * -20
        (Event.LEFTOVER, 0, Component.LEFTOVER, (0, 0, 0, 0)),
    ],
)
def test_each_row_of_table_3(
    event: Event, amount: float, component: Component, stages: tuple[float, ...]
) -> None:
    """Each event is worth Table 3's points times Table 2's multiplier of the stage."""
    settings = composed()
    assert TABLE_3[event][0] is component
    found = [
        award(settings.rewards, stage.multipliers)(event, amount)
        for stage in settings.curriculum.stages
    ]
    assert found == pytest.approx(stages)


@pytest.mark.parametrize(
    ("battery", "expected"),
    [
        (0, 800), (14.999, 800), (15, 400), (24.999, 400), (25, 200), (44.999, 200),
        (45, 65), (70, 90), (94.9, 114.9), (100, 120),
    ],
)  # fmt: skip
def test_charge_bands(battery: float, expected: float) -> None:
    """Below 15, 25 and 45 % a charge earns 800, 400, 200; above it 20 plus the level."""
    assert charge_points(composed().rewards, battery) == pytest.approx(expected)


def test_each_event_has_a_row() -> None:
    """No event is worth nothing by omission."""
    assert set(TABLE_3) == set(Event)


def test_only_five_components_have_a_multiplier() -> None:
    """Table 2 has five columns; patrol, idleness and collisions count once in every stage."""
    loud = Multipliers(garbage=2, battery=3, humanoid=4, delivery=5, leftover=6)
    assert [multiplier(loud, c) for c in Component] == [2, 3, 4, 5, 6, 1, 1, 1]


def test_fitness_is_the_sum_of_components() -> None:
    """Eq. (1): each event goes to its component, and the sum is the fitness."""
    stage = composed().curriculum.multipliers(1)  # 1.8, 2.5, 1.5, 1.2, 1.0
    events = [
        (5, Event.PICKUP, 1.0),  # 1.8 * 300 = 540
        (9, Event.PICKUP, 1.0),  # 540
        (20, Event.INTERACTION, 8.0),  # 1.5 * 720 = 1080
        (30, Event.DELIVERY, 10.0),  # 1.2 * 400 = 480
        (31, Event.EMPTY_DELIVERY, 1.0),  # 1.2 * -150 = -180
        (40, Event.CHARGE, 20.0),  # 2.5 * 400 = 1000
        (50, Event.DISCOVERY, 2.0),  # 20
        (50, Event.PATROL, 1.0),  # 13
        (60, Event.IDLE, 21.0),  # -10
        (70, Event.COLLISION, 1.0),  # -500
        (80, Event.LEFTOVER, 50.0),  # -1000
    ]
    parts = components(composed().rewards, stage, events)
    assert parts == pytest.approx((1080, 1000, 1080, 300, -1000, 33, -10, -500))
    assert sum(parts) == pytest.approx(1983)


def test_no_events_no_points() -> None:
    """An empty episode is worth 0 in every component."""
    assert components(composed().rewards, PLAIN, []) == (0,) * 8


def test_normalisation() -> None:
    """Eq. (2): with `normalize` each component is divided by its maximum, then multiplied."""
    scaled = rewards(normalize=True, maxima=(30000, 4000, 10000, 10000, 3000, 2000, 4000, 5000))
    stage = composed().curriculum.multipliers(0)  # 2.0, 1.0, 1.5, 1.0, 0.8
    events = [
        (1, Event.PICKUP, 1.0),  # 2 * 300 / 30000 = 0.02
        (2, Event.CHARGE, 10.0),  # 800 / 4000 = 0.2
        (3, Event.INTERACTION, 5.0),  # 1.5 * 585 / 10000 = 0.08775
        (4, Event.DELIVERY, 5.0),  # 250 / 10000 = 0.025
        (5, Event.LEFTOVER, 100.0),  # 0.8 * -2000 / 3000 = -0.53333...
        (6, Event.PATROL, 1.0),  # 13 / 2000 = 0.0065
        (7, Event.IDLE, 30.0),  # -10 / 4000 = -0.0025
        (8, Event.COLLISION, 1.0),  # -500 / 5000 = -0.1
    ]
    expected = (0.02, 0.2, 0.08775, 0.025, -1600 / 3000, 0.0065, -0.0025, -0.1)
    assert components(scaled, stage, events) == pytest.approx(expected)


def test_award_is_points() -> None:
    """What the island counts while an episode runs is what is scored in the end."""
    give = award(composed().rewards, PLAIN)
    scored = components(composed().rewards, PLAIN, [(0, Event.DELIVERY, 4)])
    assert give(Event.DELIVERY, 4) == scored[Component.DELIVERY] == sum(scored) == 220


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"maxima": (1,) * 7}, "expected 8 positive numbers"),
        ({"maxima": (1,) * 7 + (0,)}, "expected 8 positive numbers"),
        ({"charge": ({"below": 25, "points": 1}, {"below": 15, "points": 2})}, "rising level"),
        ({"collision": float("nan")}, "finite"),
        ({"pickup": {"base": float("inf"), "per_item": 1}}, "finite"),
    ],
)
def test_rewards_that_make_no_sense(change: dict[str, object], message: str) -> None:
    """Rewards that no fitness can be made of are refused."""
    with pytest.raises(ValidationError, match=message):
        rewards(**change)
