"""The seven actions of section 2.2.3, each a function of the island.

An action is called once a tick while its leaf runs; `fresh` is true on the
first call. It returns a status, turns the wheels or not, and says with
`wake_at` when its status may change. A new action is an entry in
`bt.node.ACTIONS` and a function here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot
from typing import Final

from islandgp.bt.node import FAILURE, RUNNING, SUCCESS
from islandgp.island.journal import Event
from islandgp.island.robot import FULL, MICRO
from islandgp.island.state import Island

AIM_EVERY = 5  # steps: how often MoveToHumanoid aims anew at a walking humanoid


def move_to_garbage(island: Island, fresh: bool) -> int:
    """Drives to the nearest garbage in sight."""
    robot, ground = island.robot, island.ground
    if fresh:
        island.item, gap = ground.nearest(robot.x, robot.y)
        if gap > robot.settings.perception:
            return FAILURE
    at = complex(ground.where[island.item])
    if at.real > island.world.side:  # somebody in the same tree took it
        return FAILURE
    return _drive(island, at.real, at.imag, robot.settings.pickup_reach)


def pickup_garbage(island: Island, _fresh: bool) -> int:
    """Picks up the nearest item, at once."""
    robot, ground = island.robot, island.ground
    if robot.room <= 0:
        return FAILURE
    item, gap = ground.nearest(robot.x, robot.y)
    if gap > robot.settings.pickup_reach:
        return FAILURE
    ground.take(item)
    ground.due = 0
    robot.load += 1
    island.act(Event.PICKUP, 1)
    return SUCCESS


def seek_charger(island: Island, _fresh: bool) -> int:
    """Drives to the nearest charger."""
    return _drive_to_station(island, island.world.chargers)


def execute_charge(island: Island, fresh: bool) -> int:
    """Charges until full; an attempt counts anew when a good part of a charge was used up."""
    robot, chargers = island.robot, island.world.chargers
    x, y = chargers[_nearest(island, chargers)]
    if hypot(x - robot.x, y - robot.y) > robot.settings.station_reach:
        return FAILURE
    if fresh and robot.battery >= robot.settings.charge_below * MICRO:
        return FAILURE
    if robot.battery >= FULL:
        return SUCCESS
    if robot.spent >= robot.settings.charge_again * MICRO:
        robot.spent = 0
        island.act(Event.CHARGE, robot.battery / MICRO)
    island.acted = robot.charging = True
    return RUNNING


def move_to_humanoid(island: Island, fresh: bool) -> int:
    """Drives to the nearest humanoid in sight that asks, and takes over its garbage."""
    robot, people = island.robot, island.humanoids
    if robot.room <= 0:
        return FAILURE
    if fresh:
        island.humanoid, _ = people.nearest_asking(robot.x, robot.y)
        island.aim_end = 0
    h = island.humanoid
    if h < 0 or not people.asks(h):
        return FAILURE
    x, y = people.bodies[h].position
    gap = hypot(x - robot.x, y - robot.y)
    if gap > robot.settings.perception:
        return FAILURE
    if gap <= people.settings.reach:
        people.due = 0
        island.act(Event.INTERACTION, _load(island, people.hand_over(h, robot.room)))
        return SUCCESS
    _pursue(island, x, y, gap)
    return RUNNING


def deliver_to_clearing_point(island: Island, _fresh: bool) -> int:
    """Drives to the nearest clearing point and unloads; an empty delivery costs once a visit."""
    robot, points = island.robot, island.world.clearing_points
    if _drive_to_station(island, points) == RUNNING:
        return RUNNING
    if robot.load > 0:
        island.act(Event.DELIVERY, robot.load)
        robot.load = 0
        return SUCCESS
    here = _nearest(island, points)
    if robot.clearing_point != here:
        robot.clearing_point = here
        island.act(Event.EMPTY_DELIVERY, 1)
    return FAILURE


def patrol_waypoint(island: Island, _fresh: bool) -> int:
    """Drives to the next waypoint; after the last one a lap is finished."""
    robot, waypoints = island.robot, island.world.waypoints
    status = _drive(island, *waypoints[robot.waypoint], robot.settings.station_reach)
    if status == SUCCESS:
        robot.waypoint = (robot.waypoint + 1) % len(waypoints)
        robot.laps += robot.waypoint == 0
    else:
        island.patrolling = True
    return status


ACTIONS: Final[dict[str, Callable[[Island, bool], int]]] = {
    "MoveToGarbage": move_to_garbage,
    "PickupGarbage": pickup_garbage,
    "SeekCharger": seek_charger,
    "ExecuteCharge": execute_charge,
    "MoveToHumanoid": move_to_humanoid,
    "DeliverToClearingPoint": deliver_to_clearing_point,
    "PatrolWaypoint": patrol_waypoint,
}


def _drive(island: Island, x: float, y: float, reach: float) -> int:
    """RUNNING while the wheels turn towards (x, y), SUCCESS within reach."""
    again = island.robot.drive(island.step, x, y, reach)
    if again < 0:
        return SUCCESS
    island.wake_at(again)
    return RUNNING


def _drive_to_station(island: Island, stations: Sequence[tuple[float, float]]) -> int:
    return _drive(
        island, *stations[_nearest(island, stations)], island.robot.settings.station_reach
    )


def _nearest(island: Island, stations: Sequence[tuple[float, float]]) -> int:
    """The station that is nearest to the robot, the first of equals."""
    rx, ry = island.robot.x, island.robot.y
    return min(range(len(stations)), key=lambda i: hypot(stations[i][0] - rx, stations[i][1] - ry))


def _pursue(island: Island, x: float, y: float, gap: float) -> None:
    """Drives to where the humanoid at (x, y) was last aimed at, and aims anew now and then."""
    robot, people = island.robot, island.humanoids
    if island.step >= island.aim_end or robot.drive(island.step, *island.aim, 0.0) < 0:
        island.aim = (x, y)
        island.aim_end = island.step + AIM_EVERY
    _drive(island, *island.aim, 0.0)
    closing = robot.stride + people.settings.speed * island.world.episode.step
    room = min(gap - people.settings.reach, robot.settings.perception - gap)
    island.wake_at(min(island.aim_end, island.step + max(1, int(room / closing))))


def _load(island: Island, items: int) -> int:
    island.robot.load += items
    return items
