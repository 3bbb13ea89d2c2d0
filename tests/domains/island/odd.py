"""Worlds with numbers that nobody would choose, as a strategy."""

from __future__ import annotations

from typing import Any

from hypothesis import assume
from hypothesis import strategies as st
from pydantic import ValidationError

from islandgp.domains.island.schedule import obstacles
from islandgp.domains.island.world import IslandWorld
from islandgp.errors import ConfigError
from tests.domains.island.days import world

SIDE = 90  # m


def _points(draw: st.DrawFn, heap: tuple[float, float], minimum: int) -> list[list[float]]:
    """Places; about half of them lie in a heap, where one may be in reach of another."""
    anywhere = st.floats(3, SIDE - 3)
    near = [st.floats(max(3, v - 4), min(SIDE - 3, v + 4)) for v in heap]
    place = st.one_of(st.tuples(anywhere, anywhere), st.tuples(*near))
    return [list(map(float, p)) for p in draw(st.lists(place, min_size=minimum, max_size=5))]


@st.composite
def odd_worlds(draw: st.DrawFn) -> IslandWorld:
    """Small islands: any speeds, reaches, steps, batteries and crowds that fit together."""

    def one(*values: Any) -> Any:
        return draw(st.sampled_from(values))

    heap = (draw(st.floats(10, SIDE - 10)), draw(st.floats(10, SIDE - 10)))
    ask_from = one(1, 2, 5)
    try:
        island = world(
            side=SIDE,
            start=_points(draw, heap, 1)[0],
            chargers=_points(draw, heap, 1),
            clearing_points=_points(draw, heap, 1),
            waypoints=_points(draw, heap, 2),
            robot={
                "speed": one(0.5, 3, 5, 8, 12),
                "radius": one(0.1, 0.6, 1.0),
                "capacity": one(1, 3, 30),
                "perception": one(1, 3, 15, 40),
                "pickup_reach": one(0.05, 0.3, 1, 1.5),
                "station_reach": one(0.05, 0.5, 2, 8, 20),
                "battery_start": draw(st.floats(1, 100)),
                "drain_moving": one(0, 0.2, 1 / 3, 3),
                "drain_standing": one(0, 0.05, 2),
                "charge_rate": one(1e-6, 1, 5, 1000),
                "charge_below": one(0, 50, 95, 100),
                "charge_again": one(0, 10, 100),
                "patrol_segment": one(1, 20),
            },
            garbage={"initial": one(0, 3, 30), "every": one(0.1, 1, 10), "most": one(30, 100)},
            humanoids={
                "count": one(0, 4, 12),
                "speed": one(0.1, 1.2, 3, 5),
                "radius": one(0.1, 0.4, 1.0),
                "turn_every": one([0.1, 0.3], [4, 10]),
                "most_items": one(ask_from, 10),
                "ask_from": ask_from,
                "reach": one(0.3, 2, 8),
            },
            obstacles={"count": one(0, 4, 8), "radius": one([1, 2], [3, 6]), "gap": one(2.8, 4)},
            episode={
                "step": one(0.02, 0.1, 0.25, 0.5),
                "length": one(30, 60, 90),
                "stagnation": one(10, 120),
                "negative": one(5, 60),
                "low_battery": one(0, 40, 100),
            },
        )
        obstacles(island)
    except (ValidationError, ConfigError):
        assume(False)
    return island
