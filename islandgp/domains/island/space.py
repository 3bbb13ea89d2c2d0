"""The physics of the island: walls, rocks, bodies and their contacts, in pymunk.

Chipmunk's result depends on the order in which bodies are added, so they are
added here in one fixed order. Humanoids pass each other, bounce off walls and
rocks, and step aside when the robot touches them.

Building a space takes as long as a thousand of its steps. So a space is used again by
later episodes in the same world: its bodies are taken out, placed, and added again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache

import numpy as np
import pymunk
from pymunk.batch import BodyFields, Buffer, get_space_bodies

from islandgp.domains.island import engine
from islandgp.domains.island.schedule import Circle, Schedule
from islandgp.domains.island.world import WALL, IslandWorld

ROBOT_MASS, HUMANOID_MASS = 50.0, 70.0  # kg
HUMANOID_GROUP = 1  # shapes of one group do not collide


class CollisionType(IntEnum):
    """Chipmunk's collision types."""

    ROBOT = 1
    HUMANOID = 2
    STATIC = 3


@dataclass(slots=True)
class Contacts:
    """The robot's contacts, updated by the physics engine."""

    begun: list[int] = field(default_factory=list)  # humanoids touched since last asked
    touching: set[int] = field(default_factory=set)  # humanoids; -1 and below: static shapes
    flag: bytearray = field(default_factory=lambda: bytearray(1))  # 1: it touches something


class Space:
    """A space with the bodies of one episode, and their positions read all at once."""

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
        self.handle, self._robot = engine.handle(space), engine.handle(robot)
        self._movers = [(body, next(iter(body.shapes))) for body in (robot, *humanoids)]
        self._buffer = Buffer()
        self._read()
        # The engine's own memory; it stays in place, as each reading fills it to the same size.
        # The robot comes first, then the humanoids, last the static body: x + iy in metres.
        self._positions = np.frombuffer(self._buffer.float_buf(), dtype=complex)

    def reset(self, world: IslandWorld, schedule: Schedule) -> None:
        """Resets the space to step 0 of a schedule with as many humanoids."""
        starts = ((*world.start, 0.0, 0.0), *schedule.humanoids)
        engine.restart(self.space, self._movers, starts)
        self.contacts.begun.clear()
        self.contacts.touching.clear()
        self.contacts.flag[0] = False

    def robot_position(self) -> complex:
        """Position of the robot, x + iy in metres."""
        at = engine.position(self._robot)
        return complex(at.x, at.y)

    def humanoid_positions(self) -> list[complex]:
        """Positions of the humanoids in metres, read in one call of the engine."""
        self._read()
        positions: list[complex] = self._positions[1:-1].tolist()
        return positions

    def _read(self) -> None:
        self._buffer.clear()
        get_space_bodies(self.space, BodyFields.POSITION, self._buffer)


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
    for i, (x, y, vx, vy) in enumerate(schedule.humanoids):
        body = pymunk.Body(HUMANOID_MASS, float("inf"))
        body.position = (x, y)
        body.velocity = (vx, vy)
        shape = pymunk.Circle(body, world.humanoids.radius)
        shape.elasticity = 1.0
        shape.collision_type = CollisionType.HUMANOID
        shape.filter = pymunk.ShapeFilter(group=HUMANOID_GROUP)
        space.add(body, shape)
        index[shape] = i
        humanoids.append(body)
    contacts = Contacts()
    _watch_contacts(space, index, contacts)
    return Space(space, robot, tuple(humanoids), contacts)


def _watch_contacts(
    space: pymunk.Space, index: dict[pymunk.Shape, int], contacts: Contacts
) -> None:
    def begin(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        other = index[arbiter.shapes[1]]
        contacts.touching.add(other)
        contacts.flag[0] = True
        if other >= 0:
            contacts.begun.append(other)

    def separate(arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        # When a space is deleted, the engine separates all contacts, perhaps after `index` is gone.
        contacts.touching.discard(index.get(arbiter.shapes[1], 0))
        contacts.flag[0] = bool(contacts.touching)

    for kind in (CollisionType.HUMANOID, CollisionType.STATIC):
        space.on_collision(CollisionType.ROBOT, kind, begin=begin, separate=separate)
