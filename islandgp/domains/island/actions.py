"""The seven actions of section 2.2.3 of the paper (docs/paper.md), each a function of the island.

An action is called once per tick while its leaf runs; `fresh` is True on the first call. It
returns a status and may turn the wheels. As the island skips ticks that change nothing, an action
that may end at a known step calls `wake_at` with it while it is RUNNING, and an action whose result
depends on the robot's position calls `same_for`, also if it ends at once, with the distance within
which a fresh call would have the same result. `docs/extending.md` shows how to add an action.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import hypot, inf
from typing import Final

from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS
from islandgp.domains.island.events import IslandEvent
from islandgp.domains.island.robot import FULL, MICRO, steps_to
from islandgp.domains.island.state import State

IslandAction = Callable[[State, bool], int]
"""(island, fresh) to a status."""

AIM_EVERY: Final = 5  # steps after which MoveToHumanoid updates its aim at a walking humanoid


def move_to_garbage(island: State, fresh: bool) -> int:
    """Drives to the nearest garbage in sight."""
    robot, ground, lead = island.robot, island.ground, inf
    if fresh:
        island.item, gap, second = ground.nearest(robot.x, robot.y)
        sight = robot.perception
        if gap > sight:
            island.same_for(gap - sight)
            return FAILURE
        lead = min(second, sight) - gap
    item = island.item
    if item < 0 or not ground.present[item]:  # another branch of the tree has taken it
        return FAILURE
    x, y = ground.places.x[item], ground.places.y[item]
    return drive(island, x, y, robot.pickup_reach, lead)


def pickup_garbage(island: State, _fresh: bool) -> int:
    """Picks up the nearest item, at once."""
    robot, ground = island.robot, island.ground
    if robot.room <= 0:
        return FAILURE
    item, gap, _ = ground.nearest(robot.x, robot.y)
    if gap > robot.pickup_reach:
        island.same_for(gap - robot.pickup_reach)
        return FAILURE
    ground.take(item)
    robot.load += 1
    island.act(IslandEvent.PICKUP, 1)
    return SUCCESS


def seek_charger(island: State, fresh: bool) -> int:
    """Drives to the nearest charger."""
    robot, chargers, lead = island.robot, island.world.chargers, inf
    if fresh:
        robot.charger, _, lead = _nearest(island, chargers)
    return drive(island, *chargers[robot.charger], robot.station_reach, lead)


def execute_charge(island: State, fresh: bool) -> int:
    """Charges until full; logs `charge` again only after `charge_again` percent were used."""
    robot = island.robot
    _, gap, _ = _nearest(island, island.world.chargers)
    beyond = gap - robot.station_reach
    island.same_for(abs(beyond))
    if beyond > 0:
        return FAILURE
    if fresh and robot.battery >= robot.settings.charge_below * MICRO:
        return FAILURE
    if robot.battery >= FULL:
        return SUCCESS
    if robot.spent >= robot.settings.charge_again * MICRO:
        robot.spent = 0
        island.act(IslandEvent.CHARGE, robot.battery / MICRO)
    island.acted = robot.charging = True
    return RUNNING


def move_to_humanoid(island: State, fresh: bool) -> int:
    """Drives to the nearest humanoid in sight that asks, and takes over its garbage.

    It fails if no humanoid in sight asks, or if the robot has no room.
    """
    robot, people = island.robot, island.humanoids
    if robot.room <= 0:
        return FAILURE
    position = complex(robot.x, robot.y)
    if fresh:
        island.humanoid = people.nearest_asking(position)
        island.aim_end = 0
    humanoid = island.humanoid
    if humanoid < 0 or not people.asks(humanoid):
        return FAILURE
    place = people.position(humanoid)
    gap = abs(place - position)
    if gap > robot.perception:
        return FAILURE
    if gap <= people.settings.reach:
        items = people.hand_over(humanoid, robot.room)
        robot.load += items
        island.act(IslandEvent.INTERACTION, items)
        return SUCCESS
    _pursue(island, place, gap)
    return RUNNING


def deliver_to_clearing_point(island: State, fresh: bool) -> int:
    """Drives to the nearest clearing point and unloads; an empty robot is fined once per visit."""
    robot, points, lead = island.robot, island.world.clearing_points, inf
    if fresh:
        robot.clearing_point, _, lead = _nearest(island, points)
    target = robot.clearing_point
    if drive(island, *points[target], robot.station_reach, lead) == RUNNING:
        return RUNNING
    island.same_for(lead / 2)  # then another clearing point may be the nearest
    if robot.load > 0:
        island.act(IslandEvent.DELIVERY, robot.load)
        robot.load = 0
        return SUCCESS
    if robot.fined_at != target:
        robot.fined_at = target
        island.act(IslandEvent.EMPTY_DELIVERY, 1)
    return FAILURE


def patrol_waypoint(island: State, _fresh: bool) -> int:
    """Drives to the next waypoint; after the last one a lap is finished."""
    robot, waypoints = island.robot, island.world.waypoints
    status = drive(island, *waypoints[robot.waypoint], robot.station_reach)
    if status == SUCCESS:
        robot.waypoint = (robot.waypoint + 1) % len(waypoints)
        robot.laps += robot.waypoint == 0
        island.stirred = True
    else:
        island.patrolling = True
    return status


ACTIONS: Final[Mapping[str, IslandAction]] = {
    "MoveToGarbage": move_to_garbage,
    "PickupGarbage": pickup_garbage,
    "SeekCharger": seek_charger,
    "ExecuteCharge": execute_charge,
    "MoveToHumanoid": move_to_humanoid,
    "DeliverToClearingPoint": deliver_to_clearing_point,
    "PatrolWaypoint": patrol_waypoint,
}


def drive(island: State, x: float, y: float, reach: float, lead: float = inf) -> int:
    """RUNNING while the wheels turn towards (x, y), SUCCESS within reach.

    `lead`: see `IslandRobot.drive_to`; inf if the call is not fresh, as a running action keeps its
    goal.
    """
    robot = island.robot
    distance = hypot(x - robot.x, y - robot.y)
    if distance <= reach:
        island.same_for(reach - distance)
        return SUCCESS
    robot.drive_to(x, y, reach, lead)
    island.wake_at(island.step + steps_to(distance - reach, robot.stride))
    return RUNNING


def _nearest(island: State, stations: Sequence[tuple[float, float]]) -> tuple[int, float, float]:
    """The nearest station, the first of equals, the metres to it, and by how many it is nearer."""
    rx, ry = island.robot.x, island.robot.y
    first, least, next_one, second = -1, inf, -1, inf  # squares of distances
    for i, (x, y) in enumerate(stations):
        dx, dy = x - rx, y - ry
        square = dx * dx + dy * dy
        if square < least:
            first, least, next_one, second = i, square, first, least
        elif square < second:
            next_one, second = i, square
    gap = hypot(stations[first][0] - rx, stations[first][1] - ry)
    if next_one < 0:
        return first, gap, inf
    return first, gap, hypot(stations[next_one][0] - rx, stations[next_one][1] - ry) - gap


def _pursue(island: State, place: complex, gap: float) -> None:
    """Drives to the last aim at a humanoid, which is at `place`; updates it every AIM_EVERY steps.

    `gap`: metres between the robot and the humanoid.
    """
    robot, people = island.robot, island.humanoids
    island.same_for(0)  # a fresh call would update the aim
    distance = hypot(island.aim_x - robot.x, island.aim_y - robot.y)
    if island.step >= island.aim_end or distance < robot.stride:
        island.aim_x, island.aim_y = place.real, place.imag
        island.aim_end = island.step + AIM_EVERY
        distance = hypot(island.aim_x - robot.x, island.aim_y - robot.y)
    robot.drive_to(island.aim_x, island.aim_y, 0.0)
    aim_steps = steps_to(distance - robot.stride, robot.stride)
    room = min(gap - people.settings.reach, robot.perception - gap)
    meeting_steps = steps_to(room, robot.stride + island.walk)
    island.wake_at(min(island.aim_end, island.step + min(aim_steps, meeting_steps)))
