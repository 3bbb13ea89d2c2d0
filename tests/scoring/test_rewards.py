"""Table 3 under Table 2, Eq. (1) and (2): values worked by hand, for the island and in general."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from pydantic import ValidationError

from islandgp.domain import Reward, RewardTable
from islandgp.domain.rewards import worth
from islandgp.domains.island.vocabulary import SCHEMA
from tests.composed import composed

MAXIMA = {
    "garbage": 30000, "battery": 4000, "humanoid": 10000, "delivery": 10000, "leftover": 3000,
    "patrol": 2000, "idle": 4000, "collision": 5000,
}  # fmt: skip


def rewards(**changes: object) -> RewardTable:
    """The paper's rewards, changed."""
    return RewardTable.model_validate({**composed().rewards.model_dump(), **changes})


def components(
    table: RewardTable, weights: Mapping[str, float], events: Sequence[tuple[str, float]]
) -> dict[str, float]:
    """Eq. (1): the points of (event, amount) pairs, by component."""
    value = worth(table, weights)
    points_of = dict.fromkeys(SCHEMA.components, 0.0)
    for event, amount in events:
        component, points = value(event, amount)
        points_of[component] += points
    return points_of


@pytest.mark.parametrize(
    ("event", "amount", "component", "stages"),
    [
        # amount: what the event counts; stages: points in stages 1, 2, 3, 4
        ("pickup", 1, "garbage", (600, 540, 480, 450)),  # 200 + 100
        ("interaction", 5, "humanoid", (877.5, 877.5, 1053, 1170)),  # 360 + 5 * 45
        ("interaction", 10, "humanoid", (1215, 1215, 1458, 1620)),  # 360 + 450
        ("charge", 14.9, "battery", (800, 2000, 1600, 1440)),
        ("charge", 24.9, "battery", (400, 1000, 800, 720)),
        ("charge", 44.9, "battery", (200, 500, 400, 360)),
        ("charge", 45, "battery", (65, 162.5, 130, 117)),  # 20 + 45
        ("charge", 90, "battery", (110, 275, 220, 198)),  # 20 + 90
        ("shutdown", 1, "battery", (-3000, -7500, -6000, -5400)),
        ("delivery", 10, "delivery", (400, 480, 1000, 800)),  # 100 + 10 * 30
        ("delivery", 30, "delivery", (1000, 1200, 2500, 2000)),
        ("empty_delivery", 1, "delivery", (-150, -180, -375, -300)),
        ("patrol", 1, "patrol", (13, 13, 13, 13)),
        ("discovery", 3, "patrol", (30, 30, 30, 30)),
        ("idle", 1, "idle", (0, 0, 0, 0)),
        ("idle", 20, "idle", (0, 0, 0, 0)),  # the 20th second is still free
        ("idle", 21, "idle", (-10, -10, -10, -10)),
        ("collision", 1, "collision", (-500, -500, -500, -500)),
        ("leftover", 120, "leftover", (-1920, -2400, -3600, -4800)),  # 120 * -20
        ("leftover", 0, "leftover", (0, 0, 0, 0)),
    ],
)
def test_each_row_of_table_3(
    event: str, amount: float, component: str, stages: tuple[float, ...]
) -> None:
    """Each event is worth Table 3's points times Table 2's multiplier of the stage."""
    settings = composed()
    stages_ = range(len(settings.curriculum.stages))
    values = [worth(settings.rewards, settings.curriculum.multipliers(i)) for i in stages_]
    assert {value(event, amount)[0] for value in values} == {component}
    assert [value(event, amount)[1] for value in values] == pytest.approx(stages)


@pytest.mark.parametrize(
    ("battery", "expected"),
    [
        (0, 800), (14.999, 800), (15, 400), (24.999, 400), (25, 200), (44.999, 200),
        (45, 65), (70, 90), (94.9, 114.9), (100, 120),
    ],
)  # fmt: skip
def test_charge_bands(battery: float, expected: float) -> None:
    """Below 15, 25 and 45 % a charge earns 800, 400, 200; above it 20 plus the level."""
    assert composed().rewards.events["charge"].points(battery) == pytest.approx(expected)


def test_an_event_without_a_row_earns_nothing() -> None:
    """It belongs to no component, and what a domain reports for it is not lost on the others."""
    value = worth(RewardTable(events={"pickup": Reward(component="garbage", base=2)}), {})
    assert value("pickup", 1) == ("garbage", 2)
    assert value("charge", 50) == ("", 0)


def test_only_named_components_have_a_multiplier() -> None:
    """Table 2 has five columns; patrol, idleness and collisions count once in every stage."""
    loud = {"garbage": 2, "battery": 3, "humanoid": 4, "delivery": 5, "leftover": 6}
    value = worth(composed().rewards, loud)
    quiet = worth(composed().rewards, {})
    for event, amount in (
        ("pickup", 1),
        ("charge", 9),
        ("patrol", 1),
        ("idle", 30),
        ("leftover", 2),
    ):
        component, points = quiet(event, amount)
        assert value(event, amount) == (component, points * loud.get(component, 1))


def test_fitness_is_the_sum_of_components() -> None:
    """Eq. (1): each event goes to its component, and the sum is the fitness."""
    stage = composed().curriculum.multipliers(1)  # 1.8, 2.5, 1.5, 1.2, 1.0
    events = [
        ("pickup", 1.0),  # 1.8 * 300 = 540
        ("pickup", 1.0),  # 540
        ("interaction", 8.0),  # 1.5 * 720 = 1080
        ("delivery", 10.0),  # 1.2 * 400 = 480
        ("empty_delivery", 1.0),  # 1.2 * -150 = -180
        ("charge", 20.0),  # 2.5 * 400 = 1000
        ("discovery", 2.0),  # 20
        ("patrol", 1.0),  # 13
        ("idle", 21.0),  # -10
        ("collision", 1.0),  # -500
        ("leftover", 50.0),  # -1000
    ]
    parts = components(composed().rewards, stage, events)
    assert list(parts.values()) == pytest.approx([1080, 1000, 1080, 300, -1000, 33, -10, -500])
    assert sum(parts.values()) == pytest.approx(1983)


def test_normalisation() -> None:
    """Eq. (2): with `maxima` each component is divided by its maximum, then multiplied."""
    scaled = rewards(maxima=MAXIMA)
    stage = composed().curriculum.multipliers(0)  # 2.0, 1.0, 1.5, 1.0, 0.8
    events = [
        ("pickup", 1.0),  # 2 * 300 / 30000 = 0.02
        ("charge", 10.0),  # 800 / 4000 = 0.2
        ("interaction", 5.0),  # 1.5 * 585 / 10000 = 0.08775
        ("delivery", 5.0),  # 250 / 10000 = 0.025
        ("leftover", 100.0),  # 0.8 * -2000 / 3000 = -0.53333...
        ("patrol", 1.0),  # 13 / 2000 = 0.0065
        ("idle", 30.0),  # -10 / 4000 = -0.0025
        ("collision", 1.0),  # -500 / 5000 = -0.1
    ]
    expected = [0.02, 0.2, 0.08775, 0.025, -1600 / 3000, 0.0065, -0.0025, -0.1]
    assert list(components(scaled, stage, events).values()) == pytest.approx(expected)
    assert components(rewards(), stage, events)["garbage"] == 600


# One row


@pytest.mark.parametrize(
    ("row", "amount", "points"),
    [
        ({}, 5, 0),
        ({"base": 7}, 5, 7),
        ({"per_unit": 3}, 5, 15),
        ({"base": 7, "per_unit": -3}, 5, -8),
        ({"base": 7, "per_unit": 3}, 0, 7),
        # over: an amount up to this earns nothing, and is not subtracted
        ({"base": 7, "per_unit": 3, "over": 5}, 5, 0),
        ({"base": 7, "per_unit": 3, "over": 5}, 5.5, 23.5),
        ({"base": 7, "over": 0}, 0, 0),
        ({"base": 7, "over": -1}, 0, 7),
        # bands: the first level above the amount; base and per_unit hold from the last one on
        ({"bands": [(10, 1), (20, 2)], "base": 3}, -5, 1),
        ({"bands": [(10, 1), (20, 2)], "base": 3}, 9.99, 1),
        ({"bands": [(10, 1), (20, 2)], "base": 3}, 10, 2),
        ({"bands": [(10, 1), (20, 2)], "base": 3, "per_unit": 1}, 20, 23),
        ({"bands": [(10, 1)], "over": 5}, 5, 0),
        ({"bands": [(10, 1)], "over": 5}, 6, 1),
        ({"bands": [(10, 1), (10, 2)]}, 9, 1),
    ],
)
def test_a_row(row: dict[str, Any], amount: float, points: float) -> None:
    """Points of one event by its amount."""
    bands = [{"below": below, "points": worth_it} for below, worth_it in row.get("bands", ())]
    reward = Reward.model_validate({**row, "component": "c", "bands": bands})
    assert reward.points(amount) == pytest.approx(points)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bands": [{"below": 25, "points": 1}, {"below": 15, "points": 2}]}, "bands: .*rising"),
        ({"base": float("nan")}, "finite"),
        ({"per_unit": float("inf")}, "finite"),
        ({"bands": [{"below": float("nan"), "points": 1}]}, "finite"),
        ({"per_item": 1}, "not permitted"),
        ({"component": None}, "string"),
    ],
)
def test_rows_that_make_no_sense(change: dict[str, object], message: str) -> None:
    """Rewards that no fitness can be made of are refused."""
    with pytest.raises(ValidationError, match=message):
        Reward.model_validate({"component": "c", **change})


@pytest.mark.parametrize(
    ("change", "lines"),
    [
        ({}, []),
        (
            {"events": {"picknick": {"component": "garbage"}}},
            ["rewards.events.picknick: expected one of pickup, interaction, "],
        ),
        (
            {"events": {"pickup": {"component": "trash"}}},
            ["rewards.events.pickup.component: expected one of garbage, battery, "],
        ),
        (
            {"maxima": {**MAXIMA, "fun": 1}},
            ["rewards.maxima.fun: expected one of garbage, battery, "],
        ),
        ({"maxima": {}}, []),
        (
            {"maxima": {**MAXIMA, "idle": 0}},
            ["rewards.maxima.idle: expected a number above 0, as others have one"],
        ),
        (
            {"maxima": {"garbage": -1, **dict.fromkeys([*MAXIMA][1:-1], 1)}},
            ["rewards.maxima.garbage: expected a number", "rewards.maxima.collision: expected a"],
        ),
    ],
)
def test_names_that_the_domain_does_not_have(change: dict[str, Any], lines: list[str]) -> None:
    """One line each, with the path."""
    faults = list(rewards(**change).faults(SCHEMA))
    assert len(faults) == len(lines)
    for line, start in zip(faults, lines, strict=True):
        assert line.startswith(start)
