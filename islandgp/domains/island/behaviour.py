"""The seven actions of section 2.2.3 of the paper (docs/paper.md), each a compiled function.

An action is called once per tick while its leaf runs; `fresh` is True on the first call. It
returns a status and may turn the wheels. As the island skips ticks that change nothing, an action
that may end at a known step calls `wake_at` with it while it is RUNNING, and an action whose result
depends on the robot's position calls `result_holds_for`, also if it ends at once, with the
distance within which a fresh call would have the same result.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Final

from islandgp.domain import FAILURE, RUNNING, SUCCESS
from islandgp.domains.island.events import CHARGE, DELIVERY, EMPTY_DELIVERY, INTERACTION, PICKUP
from islandgp.domains.island.fields import HUMANOID, ITEM, STATION
from islandgp.domains.island.memory import compiled, norm, table
from islandgp.domains.island.motion import drive_to, result_holds_for, steps_to, wake_at
from islandgp.domains.island.sensing import log, nearby
from islandgp.domains.island.world import FULL, MICRO

AIM_EVERY: Final = 5  # steps after which MoveToHumanoid updates its aim at a walking humanoid


@compiled
def act(s, kind, amount):
    """Records a non-movement action with its event."""
    log(s, kind, amount)
    s.acted = s.world_changed = 1
    s.last_action = s.step


@compiled
def move_to_garbage(s, fresh):
    """Drives to the nearest garbage in sight."""
    items, lead = table(s.items_at, s.items, ITEM), inf
    if fresh:
        s.item, gap, second = nearest_item(s)
        if gap > s.perception:
            result_holds_for(s, gap - s.perception)
            return FAILURE
        lead = min(second, s.perception) - gap
    if s.item < 0 or not items[s.item].present:  # another branch of the tree has taken it
        return FAILURE
    return drive(s, items[s.item].x, items[s.item].y, s.pickup_reach, lead)


@compiled
def pickup_garbage(s, _fresh):
    """Picks up the nearest item, at once."""
    if s.load >= s.capacity:
        return FAILURE
    item, gap, _ = nearest_item(s)
    if gap > s.pickup_reach:
        result_holds_for(s, gap - s.pickup_reach)
        return FAILURE
    table(s.items_at, s.items, ITEM)[item].present = 0
    s.room += 1
    s.next_look = 0
    s.load += 1
    act(s, PICKUP, 1.0)
    return SUCCESS


@compiled
def seek_charger(s, fresh):
    """Drives to the nearest charger."""
    chargers, lead = table(s.chargers_at, s.chargers, STATION), inf
    if fresh:
        s.charger, _, lead = nearest_station(s, chargers)
    return drive(s, chargers[s.charger].x, chargers[s.charger].y, s.station_reach, lead)


@compiled
def execute_charge(s, fresh):
    """Charges until full; logs `charge` again only after `charge_again` percent were used."""
    _, gap, _ = nearest_station(s, table(s.chargers_at, s.chargers, STATION))
    beyond = gap - s.station_reach
    result_holds_for(s, abs(beyond))
    if beyond > 0:
        return FAILURE
    if fresh and s.battery >= s.charge_below:
        return FAILURE
    if s.battery >= FULL:
        return SUCCESS
    if s.spent >= s.charge_again:
        s.spent = 0
        act(s, CHARGE, s.battery / MICRO)
    s.acted = s.charging = 1
    return RUNNING


@compiled
def move_to_humanoid(s, fresh):
    """Drives to the nearest humanoid in sight that asks, and takes over its garbage.

    It fails if no humanoid in sight asks, or if the robot has no room.
    """
    people = table(s.humanoids_at, s.humanoids, HUMANOID)
    if s.load >= s.capacity:
        return FAILURE
    if fresh:
        s.humanoid, s.aim_end = nearest_asking(s, people), 0
    if s.humanoid < 0 or people[s.humanoid].carried < s.ask_from:
        return FAILURE
    one = people[s.humanoid]
    gap = norm(one.x - s.x, one.y - s.y)
    if gap > s.perception:
        return FAILURE
    if gap <= s.hand_over_reach:
        items = min(one.carried, s.capacity - s.load)
        one.carried -= items
        s.load += items
        one.look = s.next_humanoid_look = 0
        act(s, INTERACTION, items)
        return SUCCESS
    _pursue(s, one, gap)
    return RUNNING


@compiled
def deliver_to_clearing_point(s, fresh):
    """Drives to the nearest clearing point and unloads; an empty robot is fined once per visit."""
    points, lead = table(s.points_at, s.points, STATION), inf
    if fresh:
        s.clearing_point, _, lead = nearest_station(s, points)
    point = points[s.clearing_point]
    if drive(s, point.x, point.y, s.station_reach, lead) == RUNNING:
        return RUNNING
    result_holds_for(s, lead / 2)  # then another clearing point may be the nearest
    if s.load > 0:
        act(s, DELIVERY, s.load)
        s.load = 0
        return SUCCESS
    if s.fined_at != s.clearing_point:
        s.fined_at = s.clearing_point
        act(s, EMPTY_DELIVERY, 1.0)
    return FAILURE


@compiled
def patrol_waypoint(s, _fresh):
    """Drives to the next waypoint; after the last one a lap is finished."""
    waypoints = table(s.waypoints_at, s.waypoints, STATION)
    goal = waypoints[s.waypoint]
    status = drive(s, goal.x, goal.y, s.station_reach, inf)
    if status == SUCCESS:
        s.waypoint = (s.waypoint + 1) % len(waypoints)
        s.laps += s.waypoint == 0
        s.world_changed = 1
    else:
        s.patrolling = 1
    return status


@compiled
def drive(s, x, y, reach, lead):
    """RUNNING while the wheels turn towards (x, y), SUCCESS within reach.

    `lead`: see `drive_to`; inf if the call is not fresh, as a running action keeps its goal.
    """
    distance = norm(x - s.x, y - s.y)
    if distance <= reach:
        result_holds_for(s, reach - distance)
        return SUCCESS
    drive_to(s, x, y, reach, lead)
    wake_at(s, s.step + steps_to(distance - reach, s.stride))
    return RUNNING


@compiled
def nearest_item(s):
    """The nearest item around, and the metres to it and to the next (-1, inf: no item)."""
    items, best, nearest, second = table(s.items_at, s.items, ITEM), -1, inf, inf
    for i in nearby(s, s.x, s.y):
        if items[i].present:
            dx, dy = items[i].x - s.x, items[i].y - s.y
            square = dx * dx + dy * dy
            if square < nearest:
                best, nearest, second = i, square, nearest
            else:
                second = min(second, square)
    return best, sqrt(nearest), sqrt(second)


@compiled
def nearest_asking(s, people):
    """The nearest humanoid that asks, or -1 if none does."""
    best, nearest = -1, inf
    for h in range(len(people)):
        gap = norm(people[h].x - s.x, people[h].y - s.y)
        if people[h].carried >= s.ask_from and gap < nearest:
            best, nearest = h, gap
    return best


@compiled
def nearest_station(s, stations):
    """The nearest station, the first of equals, the metres to it, and by how many it is nearer."""
    first, least, next_one, second = -1, inf, -1, inf  # squares of distances
    for i in range(len(stations)):
        dx, dy = stations[i].x - s.x, stations[i].y - s.y
        square = dx * dx + dy * dy
        if square < least:
            first, least, next_one, second = i, square, first, least
        elif square < second:
            next_one, second = i, square
    gap = norm(stations[first].x - s.x, stations[first].y - s.y)
    if next_one < 0:
        return first, gap, inf
    return first, gap, norm(stations[next_one].x - s.x, stations[next_one].y - s.y) - gap


@compiled
def _pursue(s, one, gap):
    """Drives to the last aim at a humanoid; updates it every AIM_EVERY steps.

    `gap`: metres between the robot and the humanoid.
    """
    result_holds_for(s, 0.0)  # a fresh call would update the aim
    distance = norm(s.aim_x - s.x, s.aim_y - s.y)
    if s.step >= s.aim_end or distance < s.stride:
        s.aim_x, s.aim_y, s.aim_end = one.x, one.y, s.step + AIM_EVERY
        distance = norm(s.aim_x - s.x, s.aim_y - s.y)
    drive_to(s, s.aim_x, s.aim_y, 0.0, inf)
    aim_steps = steps_to(distance - s.stride, s.stride)
    room = min(gap - s.hand_over_reach, s.perception - gap)
    meeting_steps = steps_to(room, s.stride + s.humanoid_stride)
    wake_at(s, min(s.aim_end, s.step + min(aim_steps, meeting_steps)))
