"""Perception: camera and LiDAR with a range of 15 m, and the blackboard (section 2.2.3).

Whoever looks also says how soon a look could give something else, from the
distance to the nearest thing that matters and the speed at which it can come
nearer. Until then nobody needs to look again; this is exact, not a guess.
"""

from __future__ import annotations

from math import hypot, inf

import numpy as np

from islandgp.bt.node import KEYS
from islandgp.island.journal import Event
from islandgp.island.robot import FAR, MICRO
from islandgp.island.state import Island

BATTERY, ROOM, LAP, GARBAGE, HUMANOID = range(len(KEYS))
assert tuple(KEYS) == (
    "batteryLevel",
    "robotCurrentExtraCapacity",
    "lap",
    "foundGarbage",
    "isHumanoidWantToClear",
)


def sense(island: Island, *, always: bool = False) -> None:
    """Brings the robot's position and the blackboard up to date; `always` looks at everything."""
    robot, board = island.robot, island.board
    robot.x, robot.y = robot.body.position
    if robot.clearing_point >= 0:
        x, y = island.world.clearing_points[robot.clearing_point]
        if hypot(x - robot.x, y - robot.y) > robot.settings.station_reach:
            robot.clearing_point = -1
    if always or island.step >= island.ground.due:
        _look_at_ground(island)
    if always or island.step >= island.humanoids.due:
        _look_at_humanoids(island)
    board[BATTERY] = robot.battery / MICRO
    board[ROOM] = robot.settings.capacity - robot.load
    board[LAP] = robot.laps


def _look_at_ground(island: Island) -> None:
    robot, ground = island.robot, island.ground
    reach = robot.settings.perception
    gaps = ground.distances(robot.x, robot.y)
    nearest = float(gaps.min())
    unknown = gaps + ground.known
    next_new = float(unknown.min())
    if next_new <= reach:
        new = np.flatnonzero(unknown <= reach)
        ground.known[new] = np.inf
        discover(island, len(new))
        next_new = float((gaps + ground.known).min())
    found = nearest <= reach
    island.board[GARBAGE] = found
    margin = min(next_new - reach, reach - nearest if found else nearest - reach)
    ground.due = island.step + _steps(margin, robot.stride)


def _look_at_humanoids(island: Island) -> None:
    robot, people = island.robot, island.humanoids
    reach = robot.settings.perception
    margin, asking, new = inf, False, 0
    for h, body in enumerate(people.bodies):
        asks = people.asks(h)
        if not asks and h not in people.unseen:
            continue
        x, y = body.position
        gap = hypot(x - robot.x, y - robot.y)
        if gap <= reach:
            if h in people.unseen:
                people.unseen.discard(h)
                new += 1
            if not asks:
                continue
            asking = True
        margin = min(margin, abs(gap - reach))
    if new:
        discover(island, new)
    island.board[HUMANOID] = asking
    closing = robot.stride + people.settings.speed * island.world.episode.step
    people.due = island.step + _steps(margin, closing)


def _steps(margin: float, closing: float) -> int:
    """Steps for which nothing can cross `margin` metres at `closing` metres a step."""
    return FAR if margin > 1e8 else max(1, int(margin / closing))


def discover(island: Island, things: int) -> None:
    """Things seen for the first time count while the robot is on patrol (Table 3)."""
    if not island.patrolling:
        return
    island.log(Event.DISCOVERY, things)
    segment = int(
        island.patrol_steps * island.robot.stride / island.robot.settings.patrol_segment + 1e-9
    )
    if segment > island.rewarded_segment:
        island.rewarded_segment = segment
        island.log(Event.PATROL, 1)
