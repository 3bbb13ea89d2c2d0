"""The motion of all bodies between two steps, by Chipmunk or on straight lines.

While no body can touch anything, the bodies coast: each moves on a straight line. Then the
positions are added up here, in the same order and with the same rounding as in Chipmunk. Bodies
only coast SETTLE steps after a contact, when Chipmunk no longer stores it. The order in which
Chipmunk solves several contacts of one body depends on earlier steps, so a body with two contacts
at once sets `crowded`, and the episode is repeated without coasting.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Final

import numpy as np

from islandgp.domains.island.chipmunk import place, position, step_space, velocity
from islandgp.domains.island.fields import HUMANOID, ROCK
from islandgp.domains.island.memory import compiled, norm, table
from islandgp.domains.island.robot import TOLERANCE
from islandgp.domains.island.world import FAR

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
