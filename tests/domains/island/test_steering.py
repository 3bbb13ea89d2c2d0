"""Steering: the way leads around obstacles, never against one, and arrives."""

from __future__ import annotations

from math import hypot, inf

import numpy as np
import pytest

from islandgp.bt.core.node import RUNNING
from islandgp.domains.island import behaviour
from islandgp.domains.island.fields import ROCK
from islandgp.domains.island.motion import next_leg, turn_wheels
from islandgp.domains.island.schedule import Circle, obstacles
from islandgp.domains.island.state import State
from islandgp.domains.island.world import IslandWorld
from tests.domains.island.conftest import Lay
from tests.domains.island.days import day, points, world

Point = tuple[float, float]


def drive(
    lay: Lay,
    island: IslandWorld,
    rocks: tuple[Circle, ...],
    start: Point,
    goal: Point,
    reach: float,
) -> tuple[float, float]:
    """Drives without an engine; returns (metres driven, least distance of hull and rock)."""
    lay(obstacles=rocks)
    state, nearest = State(island, 0, points()), 1e9
    now = state.record[0]
    now["x"], now["y"] = start
    while behaviour.drive(now, *goal, reach, inf) == RUNNING:
        if now["step"] == 20_000:
            return inf, nearest
        turn_wheels(now)
        now["x"] += now["vx"] * island.episode.step
        now["y"] += now["vy"] * island.episode.step
        now["step"] += 1
        for x, y, r in rocks:
            gap = hypot(x - now["x"], y - now["y"]) - r
            nearest = min(nearest, gap - island.robot.radius)
    return now["step"] * now["stride"], nearest


def first_leg(goal: Point, *rocks: Circle) -> tuple[float, float, float]:
    """The leg from (0, 0) to 1 m around a goal: its direction and length."""
    table = np.array(rocks).view(ROCK).ravel()
    leg: tuple[float, float, float] = next_leg(0.0, 0.0, *goal, 1.0, table, (0.0, 0.0))
    return leg


def free(
    rng: np.random.Generator, island: IslandWorld, rocks: tuple[Circle, ...], clear: float
) -> Point:
    """A random place at least `clear` metres from rocks and walls."""
    while True:
        x, y = (float(v) for v in rng.uniform(clear, island.side - clear, 2))
        if all(hypot(x - rx, y - ry) >= r + clear for rx, ry, r in rocks):
            return x, y


def check_ways(lay: Lay, island: IslandWorld, seed: int, ways: int) -> None:
    """Random ways: no touch of a rock, no long detour."""
    rocks, rng = obstacles(island), np.random.default_rng(seed)
    hull, garbage = island.robot.radius, island.robot.radius + island.robot.pickup_reach
    for _ in range(ways):
        # It may be as near to a rock as its hull allows; garbage keeps some ground free.
        start, goal = free(rng, island, rocks, hull), free(rng, island, rocks, garbage)
        reach = float(rng.choice([island.robot.pickup_reach, island.robot.station_reach]))
        straight = hypot(goal[0] - start[0], goal[1] - start[1])
        driven, nearest = drive(lay, island, rocks, start, goal, reach)
        assert nearest > -1e-3, (start, goal)
        assert driven <= 1.3 * straight + 15, (start, goal)


@pytest.mark.slow
def test_many_ways(lay: Lay) -> None:
    """Over random pairs of places the robot's hull keeps off every rock, and it arrives."""
    check_ways(lay, world(), 0, 400)


@pytest.mark.slow
def test_a_crowded_island(lay: Lay) -> None:
    """The same among ninety rocks that are as near to each other as the configuration allows."""
    check_ways(lay, world(obstacles={"count": 90, "gap": 4}), 1, 200)


@pytest.mark.slow
@pytest.mark.parametrize("layout", range(8))
def test_thousands_of_ways(lay: Lay, layout: int) -> None:
    """The same on other islands, more often."""
    check_ways(
        lay, world(obstacles={"layout_seed": layout, "count": 15 + 10 * layout}), layout, 1500
    )


@pytest.mark.parametrize("goal", [(170, 150), (150, 170), (130, 150), (150, 130), (164, 164)])
def test_straight_into_the_middle(lay: Lay, goal: Point) -> None:
    """A rock exactly between start and goal, or around the straight line, is passed."""
    rocks = ((160.0, 150.0, 4.0), (150.0, 160.0, 4.0), (140.0, 150.0, 3.0), (150.0, 140.0, 2.0))
    straight = hypot(goal[0] - 150, goal[1] - 150)
    driven, nearest = drive(lay, world(), rocks, (150, 150), goal, 1.5)
    assert nearest > 0
    assert driven < 1.3 * straight


@pytest.mark.parametrize("angle", np.linspace(0, 2 * np.pi, 9)[:-1])
def test_a_goal_close_to_a_rock(lay: Lay, angle: float) -> None:
    """A goal inside the margin of a rock is reached up to its reach, from any side."""
    rocks = ((160.0, 150.0, 4.0),)
    near = 4.7  # the hull would touch: 4 + 0.6 + 0.3 m are kept
    goal = (160 + near * float(np.cos(angle)), 150 + near * float(np.sin(angle)))
    driven, nearest = drive(lay, world(), rocks, (150, 150), goal, 2.0)
    assert nearest > 0
    assert driven < 30


def test_free_way_is_straight() -> None:
    """Without anything between, the leg leads to the goal."""
    direction = first_leg((30.0, 40.0), (30.0, 0.0, 5.0), (-15.0, -20.0, 5.0))
    assert direction == (pytest.approx(0.6), pytest.approx(0.8), float("inf"))


def test_beside_and_behind() -> None:
    """A rock that the way only touches, one behind the goal, one behind the robot: no matter."""
    for rock in ((20.0, 5.0, 5.0), (60.0, 0.0, 5.0), (-4.0, 0.0, 5.0)):
        assert first_leg((50.0, 0.0), rock) == (1, 0, float("inf"))


def test_tangent() -> None:
    """A rock ahead, its centre to the left, is passed on the right: 3-4-5 triangle."""
    ux, uy, length = first_leg((20.0, 0.0), (5.0, 0.0001, 3.0))
    assert (ux, uy, length) == (
        pytest.approx(0.8, abs=1e-3),
        pytest.approx(-0.6, abs=1e-3),
        pytest.approx(4, abs=1e-3),
    )


def test_no_episode_pushes_against_a_rock() -> None:
    """In whole episodes the robot never touches a rock or a wall, for any tree action."""
    tree = """
    selector {
      when batteryLevel < 40 abort lower { sequence { SeekCharger ExecuteCharge } }
      when robotCurrentExtraCapacity <= 10 { DeliverToClearingPoint }
      when isHumanoidWantToClear { MoveToHumanoid }
      when foundGarbage { sequence { MoveToGarbage PickupGarbage } }
      PatrolWaypoint
    }
    """
    island = world(obstacles={"count": 60})
    for seed in range(2):
        trace = day(tree, island, seed=seed)
        assert trace.episode.distance > 1000
        assert not any(min(m.touching, default=0) < 0 for m in trace.moments)
