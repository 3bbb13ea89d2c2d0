"""The physics of the island: walls, rocks, bodies and their contacts, in pymunk.

Chipmunk's result depends on the order in which bodies are added, so they are
added here in one fixed order. Humanoids pass each other, bounce off walls and
rocks, and step aside when the robot touches them.

Building a space takes as long as a thousand of its steps. So a space is used again by
later episodes in the same world: its bodies are taken out, placed, and added again.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from functools import lru_cache

import numpy as np
import pymunk

from islandgp.domains.island.schedule import Circle, Schedule, Table
from islandgp.domains.island.world import WALL, IslandWorld

ROBOT_MASS, HUMANOID_MASS = 50.0, 70.0  # kg
HUMANOID_GROUP = 1  # shapes of one group do not collide


class CollisionType(IntEnum):
    """Chipmunk's collision types."""

    ROBOT = 1
    HUMANOID = 2
    STATIC = 3


class Contacts:
    """The robot's contacts, updated by the physics engine."""

    def __init__(self, humanoids: int) -> None:
        self.touching: set[int] = set()  # humanoids; -1 and below: static shapes
        # How many things it touches, how many humanoids since the last reset of this number, and
        # for each humanoid whether it is touched.
        self.table: Table = np.zeros(2 + humanoids, np.int64)

    def clear(self) -> None:
        """Forgets all contacts."""
        self.touching.clear()
        self.table[:] = 0

    def update(self, other: int, touches: bool) -> None:
        """A contact with a humanoid or a static shape begins or ends."""
        (self.touching.add if touches else self.touching.discard)(other)
        self.table[0] = len(self.touching)
        if other >= 0:
            self.table[1] += touches
            self.table[2 + other] = touches


class Space:
    """A space with the bodies of one episode."""

    def __init__(
        self,
        space: pymunk.Space,
        robot: pymunk.Body,
        humanoids: tuple[pymunk.Body, ...],
        contacts: Contacts,
    ) -> None:
        """The robot was added to `space` first, then the humanoids in their order."""
        self.space = space
        self.robot = robot
        self.humanoids = humanoids
        self.contacts = contacts
        self._movers = [(body, next(iter(body.shapes))) for body in (robot, *humanoids)]

    def reset(self, starts: Iterable[tuple[float, float, float, float]]) -> None:
        """Resets the space to step 0: x, y, vx and vy of the robot and of each humanoid."""
        self.space.remove(*(thing for mover in self._movers for thing in mover))
        for (body, shape), (x, y, vx, vy) in zip(self._movers, starts, strict=True):
            body.update_position(body, 0)  # a remaining overlap no longer moves it
            body.position, body.velocity = (x, y), (vx, vy)
            self.space.add(body, shape)
        self.contacts.clear()


@lru_cache(maxsize=4)
def idle_spaces(
    world: IslandWorld,  # noqa: ARG001 -- the cache's key
    obstacles: tuple[Circle, ...],  # noqa: ARG001
    humanoids: int,  # noqa: ARG001 -- how many
) -> list[Space]:
    """Spaces of ended episodes in such worlds, to be used again."""
    return []


def build_space(world: IslandWorld, schedule: Schedule) -> Space:
    """A fresh space at step 0."""
    space = pymunk.Space()
    index: dict[pymunk.Shape, int] = {}
    corners = [(-WALL, -WALL), (world.side + WALL, -WALL)]
    corners += [(world.side + WALL, world.side + WALL), (-WALL, world.side + WALL)]
    static: list[pymunk.Shape] = [
        pymunk.Segment(space.static_body, a, b, WALL)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    static += [pymunk.Circle(space.static_body, r, (x, y)) for x, y, r in schedule.obstacles]
    for i, shape in enumerate(static):
        shape.elasticity = 1.0
        shape.collision_type = CollisionType.STATIC
        index[shape] = -1 - i
    space.add(*static)

    robot = pymunk.Body(ROBOT_MASS, float("inf"))
    robot.position = world.start
    hull = pymunk.Circle(robot, world.robot.radius)
    hull.collision_type = CollisionType.ROBOT
    space.add(robot, hull)

    humanoids = []
    for i, start in enumerate(schedule.humanoids):
        body = pymunk.Body(HUMANOID_MASS, float("inf"))
        body.position = (float(start["x"]), float(start["y"]))
        body.velocity = (float(start["vx"]), float(start["vy"]))
        shape = pymunk.Circle(body, world.humanoids.radius)
        shape.elasticity = 1.0
        shape.collision_type = CollisionType.HUMANOID
        shape.filter = pymunk.ShapeFilter(group=HUMANOID_GROUP)
        space.add(body, shape)
        index[shape] = i
        humanoids.append(body)
    contacts = Contacts(len(humanoids))
    _watch_contacts(space, index, contacts)
    return Space(space, robot, tuple(humanoids), contacts)


def _watch_contacts(
    space: pymunk.Space, index: dict[pymunk.Shape, int], contacts: Contacts
) -> None:
    def begin(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        contacts.update(index[arbiter.shapes[1]], True)

    def separate(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        # When a space is deleted, the engine separates all contacts, perhaps after `index` is gone.
        contacts.update(index.get(arbiter.shapes[1], 0), False)

    for kind in (CollisionType.HUMANOID, CollisionType.STATIC):
        space.on_collision(CollisionType.ROBOT, kind, begin=begin, separate=separate)
