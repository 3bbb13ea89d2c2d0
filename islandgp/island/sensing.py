"""Perception: camera and LiDAR with a range of 15 m, and the blackboard (section 2.2.3).

Whoever looks also says how soon a look could give something else, from the
distance to the nearest thing that matters and the speed at which it can come
nearer. Until then nobody needs to look again; this is exact, not a guess.
"""

from __future__ import annotations

from math import hypot, inf, sqrt

from islandgp.bt.node import KEYS
from islandgp.island.journal import Event
from islandgp.island.robot import FAR, MICRO, TOLERANCE, steps_to
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
    if robot.fined_at >= 0:
        x, y = island.world.clearing_points[robot.fined_at]
        if hypot(x - robot.x, y - robot.y) > robot.settings.station_reach:
            robot.fined_at = -1
    if always or island.step >= island.ground.due:
        board[GARBAGE] = _look_for_garbage(island)
        island.ground.due = FAR
    if always or island.step >= island.humanoids.due:
        board[HUMANOID] = _look_for_humanoids(island)
    board[BATTERY] = robot.battery / MICRO
    board[ROOM] = robot.settings.capacity - robot.load
    board[LAP] = robot.laps


def _look_for_garbage(island: Island) -> bool:
    """Whether garbage is in sight; new items are discovered."""
    robot = island.robot
    x, y, square = robot.x, robot.y, robot.settings.perception**2
    found, new = False, 0
    for item in island.ground.around(x, y):
        dx, dy = item.x - x, item.y - y
        if dx * dx + dy * dy <= square:
            found = True
            if not item.seen:
                item.seen = True
                new += 1
    if new:
        discover(island, new)
    return found


def look_ahead(island: Island) -> int:
    """The step from which garbage can give something new, if the robot stays on its leg.

    Seen from a robot on a straight leg, an item is in sight along one stretch of
    the way. Something changes when a stretch begins that matters, when the last
    one ends that the robot is in, or when the robot comes near items of other
    cells. A robot that stands sees nothing new.
    """
    robot, ground = island.robot, island.ground
    if not robot.driving:
        return FAR
    x, y, ux, uy = robot.x, robot.y, robot.heading.real, robot.heading.imag
    square, found = robot.settings.perception**2, island.board[GARBAGE]
    change, last = ground.to_border(x, y, ux, uy) + robot.stride, 0.0
    for item in ground.around(x, y):
        dx, dy = item.x - x, item.y - y
        along = dx * ux + dy * uy
        half = square - dx * dx - dy * dy + along * along
        if half < -TOLERANCE:
            continue
        half = sqrt(half) if half > 0 else 0.0
        if along > half:
            if not (found and item.seen) and along - half < change:
                change = along - half
        elif along + half > last:
            last = along + half
    if found and last < change:
        change = last
    return island.step + steps_to(change, robot.stride)


def _look_for_humanoids(island: Island) -> bool:
    """Whether a humanoid in sight asks; new ones are discovered. Says when to look again."""
    robot, people = island.robot, island.humanoids
    reach, here = robot.settings.perception, complex(robot.x, robot.y)
    margin, asking, new = inf, False, 0
    for h, at in enumerate(island.physics.humanoid_positions()):
        asks = people.asks(h)
        if not asks and h not in people.unseen:
            continue
        gap = abs(at - here)
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
    closing = robot.stride + island.walk
    people.due = FAR if margin == inf else island.step + steps_to(margin, closing)
    return asking


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
