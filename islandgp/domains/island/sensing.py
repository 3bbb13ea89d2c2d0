"""Perception: camera and LiDAR with a range of 15 m, and the blackboard (section 2.2.3).

A look also computes the step from which another look could have a different result, by the distance
and the maximum speed of the nearest relevant thing. Until then no look is needed, and the results
are exact.
"""

from __future__ import annotations

from math import hypot, inf, sqrt
from typing import Final

from islandgp.domains.island import engine
from islandgp.domains.island.events import IslandEvent
from islandgp.domains.island.robot import MICRO, TOLERANCE, steps_to
from islandgp.domains.island.state import State
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import FAR

BATTERY: Final = 0  # of the blackboard
ROOM: Final = 1
LAP: Final = 2
GARBAGE: Final = 3
HUMANOID: Final = 4
assert tuple(VOCABULARY.keys) == (
    "batteryLevel",
    "robotCurrentExtraCapacity",
    "lap",
    "foundGarbage",
    "isHumanoidWantToClear",
)
TOGETHER: Final = 20  # looks at humanoids that are due within so many steps are done together


def sense(island: State, *, always: bool = False) -> bool:
    """Updates the robot's position and the two flags of the blackboard.

    Args:
        island: it is changed.
        always: look around even if the result cannot have changed.

    Returns:
        True if a flag changed or a discovery earned points.
    """
    robot, board, step = island.robot, island.board, island.step
    if not island.compiled:  # the compiled loop sets the position
        at = engine.position(robot.body)
        robot.x, robot.y = at.x, at.y
    finds = always or step >= island.ground.next_look
    meets = always or step >= island.humanoids.next_look
    if not finds and not meets:
        return island.changed
    events = len(island.event_log.events)
    if finds:
        look_for_garbage(island)
    if meets:
        asking = _look_for_humanoids(island, always)
        if asking != board[HUMANOID]:
            board[HUMANOID] = asking
            island.changed = True
    return island.changed or len(island.event_log.events) > events


def refresh(island: State) -> None:
    """Updates the other keys of the blackboard, before a tick."""
    robot, board = island.robot, island.board
    board[BATTERY] = robot.battery / MICRO
    board[ROOM] = robot.capacity - robot.load
    board[LAP] = robot.laps
    if robot.fined_at >= 0 and visit_left(island) < 0:
        robot.fined_at = -1


def visit_left(island: State) -> float:
    """Metres that the robot may drive within reach of the clearing point where it was fined."""
    robot = island.robot
    x, y = island.world.clearing_points[robot.fined_at]
    return robot.station_reach - hypot(x - robot.x, y - robot.y)


def look_for_garbage(island: State) -> None:
    """Updates whether garbage is in sight, discovers new items, and sets the step to look again.

    From a robot on a straight leg an item is visible along one stretch of the way. The result
    changes when a relevant stretch begins, when the last of the present stretches ends, or when
    the robot approaches items of other cells. For a robot at rest it does not change.
    """
    in_sight, new = island.compiled.look() if island.compiled else _look(island)
    if in_sight != island.board[GARBAGE]:
        island.board[GARBAGE] = bool(in_sight)
        island.changed = True
    if new:
        discover(island, new)


def _look(island: State) -> tuple[int, int]:
    """Whether garbage is in sight, and how many items are new; sets the step to look again."""
    robot, ground = island.robot, island.ground
    x, y, ux, uy = robot.x, robot.y, robot.heading.real, robot.heading.imag
    square = robot.sight_squared
    in_sight, new = 0, 0
    places, present, discovered = ground.places, ground.present, ground.discovered
    xs, ys, cell = places.x, places.y, places.cell
    (column, east), (row, north) = divmod(x, cell), divmod(y, cell)
    border_x = (cell - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
    border_y = (cell - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
    # Metres until the last visible item is out of sight, a new item comes into sight, and a
    # discovered one does so again.
    border = border_x if border_x < border_y else border_y
    end, change, again = 0.0, border + robot.stride, inf
    for item in places.near[(int(row) + 1) * places.columns + int(column) + 1]:
        if not present[item]:
            continue
        dx, dy = xs[item] - x, ys[item] - y
        gap = dx * dx + dy * dy
        if gap <= square:
            in_sight = 1
            if not discovered[item]:
                discovered[item] = True
                new += 1
        along = dx * ux + dy * uy
        half = square - gap + along * along
        if half < -TOLERANCE:
            continue
        half = sqrt(half) if half > 0 else 0.0
        if along <= half:
            if along + half > end:
                end = along + half
        elif discovered[item]:
            if along - half < again:
                again = along - half
        elif along - half < change:
            change = along - half
    other = end if in_sight else again
    if other < change:
        change = other
    ground.next_look = island.step + steps_to(change, robot.stride) if robot.driving else FAR
    return in_sight, new


def _look_for_humanoids(island: State, always: bool) -> bool:
    """Looks for humanoids with garbage, discovers new ones, and sets the step to look again."""
    robot, people, step = island.robot, island.humanoids, island.step
    x, y, perception, approach = robot.x, robot.y, robot.perception, robot.stride + island.walk
    items, ask_from, unseen = people.items, people.settings.ask_from, people.unseen
    asking_near, look_steps, bodies = people.asking_near, people.look_steps, people.bodies
    new = 0
    soon = FAR if always else step + TOGETHER
    for h, due in enumerate(look_steps):
        if due > soon:
            continue
        asks = items[h] >= ask_from
        asking_near[h] = False
        look_steps[h] = FAR
        if not asks and not unseen[h]:
            continue
        at = engine.position(bodies[h])
        beyond = hypot(at.x - x, at.y - y) - perception
        if asks or beyond > 0:
            look_steps[h] = step + steps_to(abs(beyond), approach)
        if beyond <= 0:
            asking_near[h] = asks
            new += unseen[h]
            unseen[h] = False
    people.next_look = min(look_steps, default=FAR)
    if new:
        discover(island, new)
    return 1 in asking_near


def discover(island: State, things: int) -> None:
    """Records things seen for the first time, which count while the robot patrols (Table 3)."""
    if not island.patrolling:
        return
    island.log(IslandEvent.DISCOVERY, things)
    steps = island.patrol_steps + island.step - island.booked
    segment = int(steps * island.robot.stride / island.robot.settings.patrol_segment + 1e-9)
    if segment > island.rewarded_segment:
        island.rewarded_segment = segment
        island.log(IslandEvent.PATROL, 1)
