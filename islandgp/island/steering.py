"""Straight legs around obstacles.

The way to a goal is a chain of straight legs: to the goal itself where nothing
stands between, else along the tangent of the first obstacle in the way. The
obstacles keep a gap, so that one at a time is enough to think of.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, inf, sqrt

from islandgp.island.script import Circle

SHORTEST_LEG = 1.0  # m: around a rock the robot drives chords of at least this length


def steer(
    x: float, y: float, goal_x: float, goal_y: float, *, reach: float, obstacles: Sequence[Circle]
) -> tuple[float, float, float]:
    """The next leg from (x, y): a unit direction, and its length in metres (inf: to the goal).

    `obstacles` are already widened by the robot's radius and a margin.
    """
    dx, dy = goal_x - x, goal_y - y
    distance = hypot(dx, dy)
    ux, uy = dx / distance, dy / distance
    span = distance - reach  # how far the straight way leads
    first = inf
    for ox, oy, radius in obstacles:
        cx, cy = ox - x, oy - y
        along = cx * ux + cy * uy  # where on the way it is nearest
        if not 0 < along < first or along - radius > span:
            continue
        aside = ux * cy - uy * cx  # > 0: its centre lies to the left
        if -radius < aside < radius and (along <= span or _inside(cx, cy, ux, uy, span, radius)):
            first, rock = along, (cx, cy, radius, aside)
    if first == inf:
        return ux, uy, inf
    return _tangent(*rock)


def _inside(cx: float, cy: float, ux: float, uy: float, span: float, radius: float) -> bool:
    """Whether the end of the way lies within the circle."""
    return hypot(cx - span * ux, cy - span * uy) < radius


def _tangent(cx: float, cy: float, radius: float, aside: float) -> tuple[float, float, float]:
    """The leg that passes the circle at (cx, cy), as seen from the robot, on its nearer side."""
    distance = hypot(cx, cy)
    ux, uy = cx / distance, cy / distance
    s = min(1.0, radius / distance)
    c = sqrt(1 - s * s)
    turn = -s if aside > 0 else s
    return ux * c - uy * turn, uy * c + ux * turn, max(SHORTEST_LEG, distance * c)
