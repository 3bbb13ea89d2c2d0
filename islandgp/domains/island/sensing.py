"""Perception: camera and LiDAR with a range of 15 m, and the blackboard (section 2.2.3).

A look also computes the step from which another look could have a different result, by the distance
and the maximum speed of the nearest relevant thing. Until then no look is needed, and the results
are exact.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Final

import numpy as np

from islandgp.domains.island.events import DISCOVERY, PATROL
from islandgp.domains.island.fields import EVENT, HUMANOID, ITEM, STATION
from islandgp.domains.island.memory import compiled, norm, table
from islandgp.domains.island.motion import TOLERANCE, steps_to
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import FAR, MICRO

KEYS: Final = len(VOCABULARY.keys)
BATTERY, ROOM, LAP, GARBAGE, ASKED = map(
    VOCABULARY.key_index.__getitem__,
    ("batteryLevel", "robotCurrentExtraCapacity", "lap", "foundGarbage", "isHumanoidWantToClear"),
)
TOGETHER: Final = 20  # looks at humanoids that are due within so many steps are done together


@compiled
def log(s, kind, amount):
    """Records an event of this step, for Python to count."""
    event = table(s.events_at, s.event_count + 1, EVENT)[s.event_count]
    event.step, event.kind, event.amount = s.step, kind, amount
    s.event_count += 1


@compiled
def sense(s, always):
    """Updates the two flags of the blackboard; `always`: also if they cannot have changed.

    Returns:
        True if a flag changed or a discovery earned points.
    """
    events = s.event_count
    if always or s.step >= s.next_look:
        look_for_garbage(s)
    if always or s.step >= s.next_humanoid_look:
        look_for_humanoids(s, always)
    return s.changed != 0 or s.event_count > events


@compiled
def _show(s, key, flag):
    """Writes a flag on the blackboard."""
    board = table(s.board_at, KEYS, np.float64)
    if board[key] != flag:
        board[key] = flag
        s.changed = 1


@compiled
def refresh(s):
    """Updates the other keys of the blackboard, before a tick."""
    board = table(s.board_at, KEYS, np.float64)
    board[BATTERY] = s.battery / MICRO
    board[ROOM] = s.capacity - s.load
    board[LAP] = s.laps
    if s.fined_at >= 0 and visit_left(s) < 0:
        s.fined_at = -1


@compiled
def visit_left(s):
    """Metres that the robot may drive within reach of the clearing point where it was fined."""
    point = table(s.points_at, s.points, STATION)[s.fined_at]
    return s.station_reach - norm(point.x - s.x, point.y - s.y)


@compiled
def nearby(s, x, y):
    """The indices of the items in the nine cells around a point: all within `cell` metres."""
    at = (int(y // s.cell) + 1) * s.columns + int(x // s.cell) + 1
    starts = table(s.cell_starts_at, at + 2, np.int64)
    return table(s.cell_items_at, starts[at + 1], np.int64)[starts[at] :]


@compiled
def look_for_garbage(s):
    """Updates whether garbage is in sight, discovers new items, and sets the step to look again.

    From a robot on a straight leg an item is visible along one stretch of the way. The result
    changes when a relevant stretch begins, when the last of the present stretches ends, or when
    the robot approaches items of other cells. For a robot at rest it does not change.
    """
    items, ux, uy = table(s.items_at, s.items, ITEM), s.heading_x, s.heading_y
    square = s.perception * s.perception
    east, north = s.x % s.cell, s.y % s.cell
    border_x = (s.cell - east) / ux if ux > 0 else east / -ux if ux < 0 else inf
    border_y = (s.cell - north) / uy if uy > 0 else north / -uy if uy < 0 else inf
    # Metres until the last visible item is out of sight, a new item comes into sight, and a
    # discovered one does so again.
    end, change, again = 0.0, min(border_x, border_y) + s.stride, inf
    in_sight, new = False, 0
    for i in nearby(s, s.x, s.y):
        item = items[i]
        if not item.present:
            continue
        dx, dy = item.x - s.x, item.y - s.y
        gap = dx * dx + dy * dy
        if gap <= square:
            in_sight = True
            new += not item.discovered
            item.discovered = 1
        along = dx * ux + dy * uy
        half = square - gap + along * along
        if half < -TOLERANCE:
            continue
        half = sqrt(half) if half > 0 else 0.0
        if along <= half:
            end = max(end, along + half)
        elif item.discovered:
            again = min(again, along - half)
        else:
            change = min(change, along - half)
    change = min(change, end if in_sight else again)
    s.next_look = s.step + steps_to(change, s.stride) if s.driving else FAR
    _show(s, GARBAGE, in_sight)
    discover(s, new)


@compiled
def look_for_humanoids(s, always):
    """Looks for humanoids with garbage, discovers new ones, and sets the step to look again."""
    people, new, asked = table(s.humanoids_at, s.humanoids, HUMANOID), 0, False
    s.next_humanoid_look = FAR
    for h in range(len(people)):
        one = people[h]
        if always or one.look <= s.step + TOGETHER:
            asks = one.carried >= s.ask_from
            one.asking_near, one.look = 0, FAR
            if asks or one.unseen:
                beyond = norm(one.x - s.x, one.y - s.y) - s.perception
                if asks or beyond > 0:
                    one.look = s.step + steps_to(abs(beyond), s.stride + s.humanoid_stride)
                if beyond <= 0:
                    one.asking_near = asks
                    new += one.unseen
                    one.unseen = 0
        asked = asked or one.asking_near != 0
        s.next_humanoid_look = min(s.next_humanoid_look, one.look)
    discover(s, new)
    _show(s, ASKED, asked)


@compiled
def discover(s, things):
    """Records things seen for the first time, which count while the robot patrols (Table 3)."""
    if not things or not s.patrolling:
        return
    log(s, DISCOVERY, things)
    metres = (s.patrol_steps + s.step - s.accounted_until) * s.stride
    segment = int(min(metres / s.patrol_segment + 1e-9, FAR))
    if segment > s.rewarded_segment:
        s.rewarded_segment = segment
        log(s, PATROL, 1.0)
