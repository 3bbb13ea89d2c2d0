"""Steering: the way leads around obstacles, never against one, and arrives."""

from __future__ import annotations

from math import hypot

import numpy as np
import pymunk
import pytest

from islandgp.domains.island.robot import IslandRobot, steer
from islandgp.domains.island.schedule import Circle, obstacles
from islandgp.domains.island.world import IslandWorld
from tests.domains.island.days import day, world

Point = tuple[float, float]


def drive(
    island: IslandWorld, rocks: tuple[Circle, ...], start: Point, goal: Point, reach: float
) -> tuple[float, float]:
    """Drives without an engine; returns (metres driven, least distance of hull and rock)."""
    body = pymunk.Body(1, 1)
    robot = IslandRobot(island, body, rocks, ())
    robot.x, robot.y = start
    nearest = 1e9
    for step in range(20_000):
        if hypot(goal[0] - robot.x, goal[1] - robot.y) <= reach:
            return step * robot.stride, nearest
        robot.drive_to(*goal, reach)
        robot.turn_wheels(step)
        robot.x += body.velocity.x * island.episode.step
        robot.y += body.velocity.y * island.episode.step
        for x, y, r in rocks:
            nearest = min(nearest, hypot(x - robot.x, y - robot.y) - r - island.robot.radius)
    return float("inf"), nearest


def free(
    rng: np.random.Generator, island: IslandWorld, rocks: tuple[Circle, ...], clear: float
) -> Point:
    """A random place at least `clear` metres from rocks and walls."""
    while True:
        x, y = (float(v) for v in rng.uniform(clear, island.side - clear, 2))
        if all(hypot(x - rx, y - ry) >= r + clear for rx, ry, r in rocks):
            return x, y


def check_ways(island: IslandWorld, seed: int, ways: int) -> None:
    """Random ways: no touch of a rock, no long detour."""
    rocks, rng = obstacles(island), np.random.default_rng(seed)
    hull, garbage = island.robot.radius, island.robot.radius + island.robot.pickup_reach
    for _ in range(ways):
        # It may be as near to a rock as its hull allows; garbage keeps some ground free.
        start, goal = free(rng, island, rocks, hull), free(rng, island, rocks, garbage)
        reach = float(rng.choice([island.robot.pickup_reach, island.robot.station_reach]))
        straight = hypot(goal[0] - start[0], goal[1] - start[1])
        driven, nearest = drive(island, rocks, start, goal, reach)
        assert nearest > -1e-3, (start, goal)
        assert driven <= 1.3 * straight + 15, (start, goal)


@pytest.mark.slow
def test_many_ways() -> None:
    """Over random pairs of places the robot's hull keeps off every rock, and it arrives."""
    check_ways(world(), 0, 400)


@pytest.mark.slow
def test_a_crowded_island() -> None:
    """The same among ninety rocks that are as near to each other as the configuration allows."""
    check_ways(world(obstacles={"count": 90, "gap": 4}), 1, 200)


@pytest.mark.slow
@pytest.mark.parametrize("layout", range(8))
def test_thousands_of_ways(layout: int) -> None:
    """The same on other islands, more often."""
    check_ways(world(obstacles={"layout_seed": layout, "count": 15 + 10 * layout}), layout, 1500)


@pytest.mark.parametrize("goal", [(170, 150), (150, 170), (130, 150), (150, 130), (164, 164)])
def test_straight_into_the_middle(goal: Point) -> None:
    """A rock exactly between start and goal, or around the straight line, is passed."""
    rocks = ((160.0, 150.0, 4.0), (150.0, 160.0, 4.0), (140.0, 150.0, 3.0), (150.0, 140.0, 2.0))
    straight = hypot(goal[0] - 150, goal[1] - 150)
    driven, nearest = drive(world(), rocks, (150, 150), goal, 1.5)
    assert nearest > 0
    assert driven < 1.3 * straight


@pytest.mark.parametrize("angle", np.linspace(0, 2 * np.pi, 9)[:-1])
def test_a_goal_close_to_a_rock(angle: float) -> None:
    """A goal inside the margin of a rock is reached up to its reach, from any side."""
    rocks = ((160.0, 150.0, 4.0),)
    near = 4.7  # the hull would touch: 4 + 0.6 + 0.3 m are kept
    goal = (160 + near * float(np.cos(angle)), 150 + near * float(np.sin(angle)))
    driven, nearest = drive(world(), rocks, (150, 150), goal, 2.0)
    assert nearest > 0
    assert driven < 30


def test_free_way_is_straight() -> None:
    """Without anything between, the leg leads to the goal."""
    direction = steer(0, 0, 30, 40, reach=1, obstacles=[(30.0, 0.0, 5.0), (-15.0, -20.0, 5.0)])
    assert direction == (pytest.approx(0.6), pytest.approx(0.8), float("inf"))


def test_beside_and_behind() -> None:
    """A rock that the way only touches, one behind the goal, one behind the robot: no matter."""
    for rock in ((20.0, 5.0, 5.0), (60.0, 0.0, 5.0), (-4.0, 0.0, 5.0)):
        assert steer(0, 0, 50, 0, reach=2, obstacles=[rock]) == (1, 0, float("inf"))


def test_tangent() -> None:
    """A rock ahead, its centre to the left, is passed on the right: 3-4-5 triangle."""
    ux, uy, length = steer(0, 0, 20, 0, reach=1, obstacles=[(5.0, 0.0001, 3.0)])
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
