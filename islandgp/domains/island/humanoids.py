"""Humanoids: they walk, collect garbage, and ask for clearing when they carry enough."""

from __future__ import annotations

from array import array
from math import inf

import pymunk

from islandgp.domains.island import engine
from islandgp.domains.island.world import HumanoidSettings


class Humanoids:
    """All humanoids of an episode, by index."""

    def __init__(self, settings: HumanoidSettings, bodies: tuple[pymunk.Body, ...]) -> None:
        self.settings = settings
        self.bodies = [engine.handle(body) for body in bodies]
        self.items = array("q", [0] * len(bodies))
        self.unseen = bytearray(b"\1" * len(bodies))
        self.asking_near = bytearray(len(bodies))  # 1: in sight, and asks
        self.look_steps = array("q", [0] * len(bodies))
        """The step from which a look at each can have another result."""
        self.next_look = 0  # the earliest of `look_steps`

    def position(self, h: int) -> complex:
        """Position of humanoid `h`, x + iy in metres."""
        at = engine.position(self.bodies[h])
        return complex(at.x, at.y)

    def asks(self, h: int) -> bool:
        """True if humanoid `h` has garbage to hand over."""
        return self.items[h] >= self.settings.ask_from

    def turn(self, h: int, vx: float, vy: float, step: int) -> None:
        """`h` takes a new heading and finds one more item; if it begins to ask, a look is due."""
        engine.steer(self.bodies[h], (vx, vy))
        items = self.items[h]
        if items < self.settings.most_items:
            self.items[h] = items + 1
            if items + 1 == self.settings.ask_from:
                self.look_at(h, step)

    def hand_over(self, h: int, room: int) -> int:
        """`h` gives at most `room` items; returns the number."""
        handed_over = min(self.items[h], room)
        self.items[h] -= handed_over
        self.look_at(h, 0)
        return handed_over

    def look_at(self, h: int, step: int) -> None:
        """A look at `h` is due at `step`."""
        self.look_steps[h] = step
        self.next_look = min(self.next_look, step)

    def look_at_all(self, step: int) -> None:
        """A look at every humanoid is due at `step`."""
        for h in range(len(self.look_steps)):
            self.look_steps[h] = step
        self.next_look = step

    def step_aside(self, h: int, position: complex, robot: complex) -> None:
        """`h` walks straight away from the robot that touches it."""
        away = position - robot
        away *= self.settings.speed / (abs(away) or 1.0)
        engine.steer(self.bodies[h], (away.real, away.imag))

    def nearest_asking(self, robot: complex) -> int:
        """The nearest humanoid that asks, or -1 if none does."""
        best, nearest, least = -1, inf, self.settings.ask_from
        for h, items in enumerate(self.items):
            if items >= least and (gap := abs(self.position(h) - robot)) < nearest:
                best, nearest = h, gap
        return best
