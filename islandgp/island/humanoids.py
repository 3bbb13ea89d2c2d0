"""Humanoids: they walk, collect garbage, and ask for clearing when they carry enough."""

from __future__ import annotations

from math import hypot

import pymunk

from islandgp.island.world import HumanoidSettings


class Humanoids:
    """All humanoids of an episode; an index is one's name."""

    def __init__(self, settings: HumanoidSettings, bodies: tuple[pymunk.Body, ...]) -> None:
        self.settings = settings
        self.bodies = bodies
        self.items = [0] * len(bodies)
        self.unseen = set(range(len(bodies)))
        self.due = 0  # step at which they must be looked at again

    def asks(self, h: int) -> bool:
        """Whether humanoid `h` wants to be cleared."""
        return self.items[h] >= self.settings.ask_from

    def turn(self, h: int, vx: float, vy: float) -> bool:
        """`h` takes a new heading and finds one more item; true when it begins to ask."""
        self.bodies[h].velocity = (vx, vy)
        if self.items[h] < self.settings.most_items:
            self.items[h] += 1
            return self.items[h] == self.settings.ask_from
        return False

    def hand_over(self, h: int, room: int) -> int:
        """`h` gives away what fits into `room`; returns the number of items."""
        given = min(self.items[h], room)
        self.items[h] -= given
        return given

    def step_aside(self, h: int, x: float, y: float) -> None:
        """`h` walks straight away from the robot at (x, y) that touches it."""
        body = self.bodies[h]
        hx, hy = body.position
        gap = hypot(hx - x, hy - y) or 1.0
        speed = self.settings.speed
        body.velocity = (speed * (hx - x) / gap, speed * (hy - y) / gap)

    def nearest_asking(self, x: float, y: float) -> tuple[int, float]:
        """The nearest humanoid that asks and its distance in metres; (-1, inf) if nobody does."""
        best, gap = -1, float("inf")
        for h, body in enumerate(self.bodies):
            if self.asks(h):
                hx, hy = body.position
                distance = hypot(hx - x, hy - y)
                if distance < gap:
                    best, gap = h, distance
        return best, gap
