"""Straight legs around obstacles.

The way to a goal is a chain of straight legs: to the goal itself where nothing
stands between, else along the tangent of the first obstacle in the way. A leg
that would run into another obstacle on its way to the tangent point gives way
to the tangent of that one, and so on.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf, sqrt

from islandgp.domains.island.schedule import Circle

SHORTEST_LEG = 1.0  # m: around a rock the robot drives chords of at least this length
TOUCHING = 1e-9  # m: a way that comes this near to a circle's rim does not cross it


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
    passed: list[Circle] = []
    while (rock := _first(x, y, leg[0], leg[1], span, obstacles)) and rock not in passed:
        passed.append(rock)
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
