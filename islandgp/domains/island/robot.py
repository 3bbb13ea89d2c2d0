"""The robot: its battery, its wheels, and its straight legs around obstacles.

Charge is counted in whole millionths of a percent, and distance in whole steps of driving, so the
sum over many steps does not depend on how they are grouped.

The way to a goal consists of straight legs: to the goal itself if no obstacle is in the way, else
along the tangent of the first obstacle. If another obstacle is in the way to the tangent point,
the leg follows the tangent of that one, and so on.
"""

from __future__ import annotations

from math import ceil, inf, sqrt
from typing import Final

import numpy as np

from islandgp.domains.island.chipmunk import steer
from islandgp.domains.island.fields import ROCK
from islandgp.domains.island.memory import compiled, norm, table
from islandgp.domains.island.world import FAR, FULL, ROCK_MARGIN

SHORTEST_LEG: Final = 1.0  # m: around a rock the robot drives chords of at least this length
TOUCHING: Final = 1e-9  # m; a way this close to a circle's rim does not cross it
TOLERANCE: Final = 1e-6  # m, far above the rounding of positions


@compiled
def steps_to(distance, stride):
    """The first step, >= 1, after which `distance` metres can be driven, at `stride` per step."""
    return int(min(max(ceil((distance - TOLERANCE) / stride), 1.0), FAR))


@compiled
def wake_at(s, step):
    """Requests a tick at `step` at the latest."""
    s.wake = min(s.wake, step)


@compiled
def result_holds_for(s, metres):
    """Declares that a fresh call of the action has the same result for the next `metres`."""
    s.free_distance = min(s.free_distance, metres)


@compiled
def drive_to(s, x, y, reach, lead):
    """Sets the goal: to be within `reach` metres of (x, y). The last goal of a tick counts.

    `lead`: metres by which this goal is nearer than any other that the same action, called fresh,
    may choose.
    """
    s.wish_x, s.wish_y, s.wish_reach, s.lead, s.driving = x, y, reach, lead, 1


@compiled
def at_goal(s):
    """True if the goal of this tick is that of the present leg."""
    return s.goal_x == s.wish_x and s.goal_y == s.wish_y and s.goal_reach == s.wish_reach


@compiled
def choice_holds_for(s):
    """Metres to drive until another goal may become nearer.

    On a straight leg none can be, as long as the goal lies ahead.
    """
    ahead = (s.wish_x - s.x) * s.heading_x + (s.wish_y - s.y) * s.heading_y > 0
    straight = ahead and at_goal(s) and s.leg_end == FAR
    return inf if straight and s.lead > TOLERANCE else s.lead / 2


@compiled
def turn_wheels(s):
    """Continues the leg, begins another one or stops; returns True if the velocity changed."""
    if not s.driving:
        s.leg_end = 0
        if not s.rolling:
            return False
        s.rolling = 0
        s.vx, s.vy = 0.0, 0.0
    else:
        if s.step < s.leg_end and at_goal(s):
            return False
        s.goal_x, s.goal_y, s.goal_reach, s.rolling = s.wish_x, s.wish_y, s.wish_reach, 1
        rocks = table(s.rocks_at, s.rocks, ROCK)
        margin = s.radius, ROCK_MARGIN
        ux, uy, length = next_leg(s.x, s.y, s.goal_x, s.goal_y, s.goal_reach, rocks, margin)
        s.heading_x, s.heading_y, s.vx, s.vy = ux, uy, ux * s.speed, uy * s.speed
        s.leg_end = FAR
        if length != inf:
            s.leg_end = s.step + int(min(max(1.0, np.rint(length / s.stride)), FAR))
    steer(s.body, s.vx, s.vy)
    return True


@compiled
def next_leg(x, y, goal_x, goal_y, reach, rocks, margin):
    """The next leg from (x, y): a unit direction, and its length in metres (inf: to the goal).

    `margin`: the robot's radius and the gap that it keeps; rocks are wider by both.
    """
    dx, dy = goal_x - x, goal_y - y
    distance = norm(dx, dy)
    ux, uy, length = dx / distance, dy / distance, inf
    span = distance - reach  # how far the way leads
    overtaken = np.zeros(len(rocks), np.bool_)
    while True:
        rock = _first(x, y, ux, uy, span, rocks, margin)
        if rock < 0 or overtaken[rock]:
            return ux, uy, length
        overtaken[rock] = True
        ux, uy, length = _tangent(x, y, ux, uy, rocks[rock], margin)
        span = length


@compiled
def _first(x, y, ux, uy, span, rocks, margin):
    """The first rock on the way of `span` metres from (x, y) in direction (ux, uy), or -1."""
    first, found = inf, -1
    for i in range(len(rocks)):
        cx, cy = rocks[i].x - x, rocks[i].y - y
        radius = rocks[i].radius + margin[0] + margin[1]
        along = cx * ux + cy * uy  # where on the way it is nearest
        if not 0 < along < first or along - radius > span:
            continue
        if abs(ux * cy - uy * cx) >= radius - TOUCHING:
            continue
        if along <= span or norm(cx - span * ux, cy - span * uy) < radius - TOUCHING:
            first, found = along, i
    return found


@compiled
def _tangent(x, y, ux, uy, rock, margin):
    """The leg from (x, y) past a rock, on the side where the way (ux, uy) passes its centre."""
    cx, cy, radius = rock.x - x, rock.y - y, rock.radius + margin[0] + margin[1]
    distance = norm(cx, cy)
    sine = min(1.0, radius / distance)
    cosine = sqrt(1 - sine * sine)
    turn = -sine if ux * cy - uy * cx > 0 else sine  # its centre is on the left: pass on the right
    vx, vy = cx / distance, cy / distance
    return (
        vx * cosine - vy * turn,
        vy * cosine + vx * turn,
        max(SHORTEST_LEG, distance * cosine),
    )


@compiled
def battery_due(s):
    """The earliest step at which the battery may cross a level that matters."""
    marks = table(s.marks_at, s.marks, np.int64)  # in ascending order
    if s.charging and not s.driving:
        if s.charge == 0:
            return FAR
        above = len(marks) - 1
        while above > 0 and marks[above - 1] >= s.battery:
            above -= 1
        return s.step + max(1, -((s.battery - marks[above]) // s.charge))
    drain = s.drain_moving if s.driving else s.drain_standing
    if drain == 0:
        return FAR
    below = 0
    while below + 1 < len(marks) and marks[below + 1] <= s.battery:
        below += 1
    return s.step + max(1, -((marks[below] - s.battery) // drain))


@compiled
def spend(s, steps):
    """Updates battery and odometer for `steps` steps of the present activity."""
    if s.charging and not s.driving:
        s.battery = min(FULL, s.battery + steps * s.charge)
        return
    used = steps * (s.drain_moving if s.driving else s.drain_standing)
    s.odometer += steps * s.driving
    s.battery -= used
    s.spent += used
