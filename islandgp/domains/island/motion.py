"""The motion of all bodies between two steps, by Chipmunk or on straight lines.

While no body can touch anything, the bodies coast: each moves on a straight line. Then the
positions are added up here, in the same order and with the same rounding as in Chipmunk. Bodies
only coast SETTLE steps after a contact, when Chipmunk no longer stores it. The order in which
Chipmunk solves several contacts of one body depends on earlier steps, so a body with two contacts
at once sets `crowded`, and the episode is repeated without coasting.

The robot has a battery and wheels, and drives on straight legs around obstacles.

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

from islandgp.domains.island.chipmunk import place, position, steer, step_space, velocity
from islandgp.domains.island.fields import HUMANOID, ROCK
from islandgp.domains.island.memory import compiled, norm, table
from islandgp.domains.island.world import FAR, FULL, ROCK_MARGIN

SHORTEST_LEG: Final = 1.0  # m: around a rock the robot drives chords of at least this length
TOUCHING: Final = 1e-9  # m; a way this close to a circle's rim does not cross it
TOLERANCE: Final = 1e-6  # m, far above the rounding of positions
SETTLE: Final = 4  # steps of Chipmunk after a contact, which it stores for three


@compiled
def touches(s):
    """True if the robot touches something."""
    contacts = table(s.contacts_at, 1, np.int64)
    return contacts[0] > 0


@compiled
def move(s, stop):
    """Steps to `stop`, or to the first contact of the robot."""
    while s.step < stop:
        if s.may_coast and s.clear_until <= s.step and s.clear_checked != s.step:
            s.clear_until, s.clear_checked = s.step + clear_steps(s), s.step
        if s.step < s.clear_until and s.since_contact >= SETTLE:
            coast(s, min(stop, s.clear_until) - s.step)
            continue
        step(s)
        if s.may_coast:
            clear = clear_steps(s)
            s.clear_until, s.clear_checked = s.step + clear, s.step
            if clear < 0:
                s.crowded = 1
                return
        if touches(s):
            return


@compiled
def step(s):
    """Makes one step by Chipmunk."""
    people = table(s.humanoids_at, s.humanoids, HUMANOID)
    if s.coasted:  # Chipmunk does not have the positions yet
        s.coasted = 0
        place(s.body, s.x, s.y)
        for h in range(len(people)):
            place(people[h].body, people[h].x, people[h].y)
    step_space(s.space, s.dt)
    s.x, s.y = position(s.body)
    s.vx, s.vy = velocity(s.body)
    for h in range(len(people)):
        people[h].x, people[h].y = position(people[h].body)
        people[h].vx, people[h].vy = velocity(people[h].body)
    s.step += 1
    s.since_contact += 1


@compiled
def coast(s, steps):
    """Moves all bodies by `steps` steps on straight lines."""
    people = table(s.humanoids_at, s.humanoids, HUMANOID)
    s.coasted = 1
    s.x, s.y = straight_on(s.x, s.y, s.vx, s.vy, s.dt, steps)
    for h in range(len(people)):
        one = people[h]
        one.x, one.y = straight_on(one.x, one.y, one.vx, one.vy, s.dt, steps)
    s.step += steps


@compiled
def straight_on(x, y, vx, vy, dt, steps):
    """The position, after `steps` steps, of a body that touches nothing."""
    dx, dy = vx * dt, vy * dt
    for _ in range(steps):
        x += dx
        y += dy
    return x, y


@compiled
def clear_steps(s):
    """Steps in which no body can touch anything; -1: one touches two things.

    A contact now sets `since_contact` to 0.
    """
    people, touching = table(s.humanoids_at, s.humanoids, HUMANOID), False
    nearest, touched = fixed_gap(s, s.x, s.y, s.radius)
    steps = (nearest - TOLERANCE) / s.stride
    fast = too_fast(s.vx, s.vy, s.dt, s.stride)
    for h in range(len(people)):
        x, y = people[h].x, people[h].y
        nearest, fixed = fixed_gap(s, x, y, s.humanoid_radius)
        gap = norm(x - s.x, y - s.y) - s.radius - s.humanoid_radius
        if gap <= TOLERANCE:
            touched += 1
            fixed += 1
        if fixed > 1:
            return -1
        touching = touching or fixed > 0
        steps = min(
            steps,
            (nearest - TOLERANCE) / s.humanoid_stride,
            (gap - TOLERANCE) / (s.stride + s.humanoid_stride),
        )
        fast = fast or too_fast(people[h].vx, people[h].vy, s.dt, s.humanoid_stride)
    if touched > 1:
        return -1
    if touched or touching:
        s.since_contact = 0
    return 0 if fast else max(0, int(min(steps, FAR)))


@compiled
def fixed_gap(s, x, y, radius):
    """Metres from a body to the nearest wall or rock, and how many of them it touches."""
    rocks = table(s.rocks_at, s.rocks, ROCK)
    nearest, touched = inf, 0
    for gap in (x - radius, y - radius, s.side - x - radius, s.side - y - radius):
        nearest = min(nearest, gap)
        touched += gap <= TOLERANCE
    for i in range(len(rocks)):
        dx, dy, reach = rocks[i].x - x, rocks[i].y - y, rocks[i].radius + radius
        square, limit = dx * dx + dy * dy, max(nearest, TOLERANCE) + reach
        if square <= limit * limit:
            gap = sqrt(square) - reach
            nearest = min(nearest, gap)
            touched += gap <= TOLERANCE
    return nearest, touched


@compiled
def too_fast(vx, vy, dt, stride):
    """True if a contact has made a body faster than it moves by itself."""
    return norm(vx, vy) * dt > stride + 1e-9


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
