"""The robot: battery, wheels and load, and its straight legs around obstacles.

Charge is counted in whole millionths of a percent, and distance in whole steps of driving, so the
sum over many steps does not depend on how they are grouped.

The way to a goal consists of straight legs: to the goal itself if no obstacle is in the way, else
along the tangent of the first obstacle. If another obstacle is in the way to the tangent point,
the leg follows the tangent of that one, and so on.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import ceil, hypot, inf, sqrt
from typing import Final

import pymunk

from islandgp.domains.island import engine
from islandgp.domains.island.schedule import Circle
from islandgp.domains.island.world import FAR, ROCK_MARGIN, IslandWorld

SHORTEST_LEG: Final = 1.0  # m: around a rock the robot drives chords of at least this length
TOUCHING: Final = 1e-9  # m; a way this close to a circle's rim does not cross it


def steer(
    x: float, y: float, goal_x: float, goal_y: float, *, reach: float, obstacles: Sequence[Circle]
) -> tuple[float, float, float]:
    """The next leg from (x, y): a unit direction, and its length in metres (inf: to the goal).

    `obstacles` are already widened by the robot's radius and a margin.
    """
    dx, dy = goal_x - x, goal_y - y
    distance = hypot(dx, dy)
    leg = (dx / distance, dy / distance, inf)
    span = distance - reach  # how far the way leads
    overtaken: list[Circle] = []
    while (rock := _first(x, y, leg[0], leg[1], span, obstacles)) and rock not in overtaken:
        overtaken.append(rock)
        leg = _tangent(x, y, leg[0], leg[1], rock)
        span = leg[2]
    return leg


def _first(
    x: float, y: float, ux: float, uy: float, span: float, obstacles: Sequence[Circle]
) -> Circle | None:
    """The first obstacle on the way of `span` metres from (x, y) in direction (ux, uy)."""
    first, rock = inf, None
    for circle in obstacles:
        ox, oy, radius = circle
        cx, cy = ox - x, oy - y
        along = cx * ux + cy * uy  # where on the way it is nearest
        if not 0 < along < first or along - radius > span:
            continue
        if abs(ux * cy - uy * cx) >= radius - TOUCHING:
            continue
        if along <= span or hypot(cx - span * ux, cy - span * uy) < radius - TOUCHING:
            first, rock = along, circle
    return rock


def _tangent(x: float, y: float, ux: float, uy: float, rock: Circle) -> tuple[float, float, float]:
    """The leg from (x, y) past a rock, on the side where the way (ux, uy) passes its centre."""
    cx, cy, radius = rock[0] - x, rock[1] - y, rock[2]
    distance = hypot(cx, cy)
    s = min(1.0, radius / distance)
    c = sqrt(1 - s * s)
    turn = -s if ux * cy - uy * cx > 0 else s  # its centre lies to the left: pass on the right
    vx, vy = cx / distance, cy / distance
    return vx * c - vy * turn, vy * c + vx * turn, max(SHORTEST_LEG, distance * c)


MICRO: Final = 1_000_000  # units of charge in one percent
FULL: Final = 100 * MICRO
TOLERANCE: Final = 1e-6  # m, far above the rounding of positions


def steps_to(distance: float, stride: float) -> int:
    """The first step, >= 1, after which `distance` metres can be driven, at `stride` per step."""
    steps = ceil((distance - TOLERANCE) / stride)
    return steps if steps > 1 else 1


class IslandRobot:
    """The state of the robot, changed by actions and by time."""

    def __init__(
        self,
        world: IslandWorld,
        body: pymunk.Body,
        rocks: tuple[Circle, ...],
        thresholds: tuple[float, ...],
    ) -> None:
        """`thresholds`: battery levels in percent that the tree compares with."""
        step, self.settings = world.episode.step, world.robot
        self.body = engine.handle(body)
        self.x, self.y = world.start  # m, at the last look
        self.load = 0  # items
        self.capacity = world.robot.capacity  # items
        self.perception = world.robot.perception  # m, the range of its sensors
        self.pickup_reach = world.robot.pickup_reach  # m
        self.station_reach = world.robot.station_reach  # m
        self.laps = 0  # patrol rounds finished
        self.waypoint = 0  # index of the next waypoint
        self.charger = 0  # index of the charger it seeks
        self.clearing_point = 0  # index of the clearing point it drives to
        # battery
        self.battery = round(world.robot.battery_start * MICRO)
        self.drain_moving = round(world.robot.drain_moving * step * MICRO)  # a step
        self.drain_standing = round(world.robot.drain_standing * step * MICRO)
        self.charge = round(world.robot.charge_rate * step * MICRO)
        levels = (*thresholds, world.episode.low_battery, world.robot.charge_below, 0, 100)
        marks = {round(t * MICRO) for t in levels}
        self.marks = sorted(m for m in marks if 0 <= m <= FULL)
        # wheels
        self.speed = world.robot.speed  # m/s
        self.sight_squared = world.robot.perception**2  # m2
        self.stride = world.robot.speed * step  # m a step
        self.rocks = tuple((x, y, r + world.robot.radius + ROCK_MARGIN) for x, y, r in rocks)
        self.driving = False  # in this step
        self.charging = False  # in this step; standing only
        self.rolling = False  # the body may have a velocity
        self.wish = self.goal = (-1.0, -1.0, 0.0)  # x, y, reach: of this tick, of the present leg
        self.lead = inf  # m by which this goal is nearer than others
        self.heading = 1 + 0j  # unit direction of the leg
        self.leg_end = 0  # step at which the next leg is planned
        self.odometer = 0  # steps spent driving
        # events that count once
        self.spent = FULL  # charge used since the last charging attempt that counted
        self.fined_at = -1  # clearing point where an empty delivery has cost in this visit, or -1

    @property
    def room(self) -> int:
        """Number of further items that it can carry."""
        return self.capacity - self.load

    def drive_to(self, x: float, y: float, reach: float, lead: float = inf) -> None:
        """Sets the goal: to be within `reach` metres of (x, y). The last goal of a tick counts.

        `lead`: metres by which this goal is nearer than any other that the same action,
        called fresh, may choose.
        """
        self.wish = (x, y, reach)
        self.lead = lead
        self.driving = True

    def same_choice(self) -> float:
        """Metres to drive until another goal may become nearer.

        On a straight leg none can be, as long as the goal lies ahead.
        """
        x, y, _ = self.wish
        ahead = (x - self.x) * self.heading.real + (y - self.y) * self.heading.imag > 0
        straight = ahead and self.goal == self.wish and self.leg_end == FAR
        return inf if straight and self.lead > TOLERANCE else self.lead / 2

    def turn_wheels(self, step: int) -> bool:
        """Continues the leg, begins another one or stops; returns True if the velocity changed."""
        if not self.driving:
            self.leg_end = 0
            if not self.rolling:
                return False
            engine.steer(self.body, (0.0, 0.0))
            self.rolling = False
            return True
        if step < self.leg_end and self.goal == self.wish:
            return False
        x, y, reach = self.goal = self.wish
        ux, uy, length = steer(self.x, self.y, x, y, reach=reach, obstacles=self.rocks)
        engine.steer(self.body, (ux * self.speed, uy * self.speed))
        self.heading = complex(ux, uy)
        self.leg_end = FAR if length == inf else step + max(1, round(length / self.stride))
        self.rolling = True
        return True

    def battery_due(self, step: int) -> int:
        """The earliest step at which the battery may cross a level that matters."""
        level = self.battery
        if self.charging and not self.driving:
            if self.charge == 0:
                return FAR
            mark = self.marks[min(bisect_left(self.marks, level), len(self.marks) - 1)]
            return step + max(1, -((level - mark) // self.charge))
        drain = self.drain_moving if self.driving else self.drain_standing
        if drain == 0:
            return FAR
        mark = self.marks[max(bisect_right(self.marks, level) - 1, 0)]
        return step + max(1, -((mark - level) // drain))

    def spend(self, steps: int) -> None:
        """Updates battery and odometer for `steps` steps of the present activity."""
        if self.charging and not self.driving:
            self.battery = min(FULL, self.battery + steps * self.charge)
            return
        charge = steps * (self.drain_moving if self.driving else self.drain_standing)
        self.odometer += steps * self.driving
        self.battery -= charge
        self.spent += charge
