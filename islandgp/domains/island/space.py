"""The physics of the island: walls, rocks, bodies and their contacts, in pymunk.

Chipmunk's result depends on the order in which bodies are added, so they are
added here in one fixed order. Humanoids pass each other, bounce off walls and
rocks, and step aside when the robot touches them.

Building a space takes as long as a thousand of its steps. So a space is used again by
later episodes in the same world: its bodies are taken out, placed, and added again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pymunk

from islandgp.domains.island.schedule import Circle, Schedule, Table
from islandgp.domains.island.world import WALL, IslandWorld

ROBOT_MASS, HUMANOID_MASS = 50.0, 70.0  # kg
HUMANOID_GROUP = 1  # shapes of one group do not collide
ROBOT, HUMANOID, STATIC = 1, 2, 3  # Chipmunk's collision types


class Contacts:
    """The robot's contacts, updated by the physics engine."""

    def __init__(self, humanoids: int) -> None:
        self.index: dict[pymunk.Shape, int] = {}  # humanoids; -1 and below: static shapes
        self.touching: set[int] = set()
        # How many things it touches, how many humanoids since the last reset of this number, and
        # for each humanoid whether it is touched.
        self.table: Table = np.zeros(2 + humanoids, np.int64)

    def clear(self) -> None:
        """Forgets all contacts."""
        self.touching.clear()
        self.table[:] = 0

    def begin(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        """A contact with a humanoid or a static shape begins."""
        self._update(self.index[arbiter.shapes[1]], True)

    def separate(self, arbiter: pymunk.Arbiter, _space: pymunk.Space, _data: object) -> None:
        """A contact ends; when a space is deleted, the engine ends all of them."""
        self._update(self.index.get(arbiter.shapes[1], 0), False)

    def _update(self, other: int, touches: bool) -> None:
        (self.touching.add if touches else self.touching.discard)(other)
        self.table[0] = len(self.touching)
        if other >= 0:
            self.table[1] += touches
            self.table[2 + other] = touches


@dataclass(frozen=True, slots=True)
class Space:
    """A space with the bodies of one episode."""

    space: pymunk.Space  # to which the robot was added first, then the humanoids in their order
    movers: tuple[tuple[pymunk.Body, pymunk.Shape], ...]
    contacts: Contacts
    idle: list[Space]  # to which it is added when its episode has ended

    @property
    def bodies(self) -> list[pymunk.Body]:
        """The bodies of the robot and of the humanoids."""
        return [body for body, _ in self.movers]

    def reset(self, starts: Iterable[tuple[float, float, float, float]]) -> None:
        """Resets the space to step 0: x, y, vx and vy of the robot and of each humanoid."""
        self.space.remove(*(thing for mover in self.movers for thing in mover))
        for (body, shape), (x, y, vx, vy) in zip(self.movers, starts, strict=True):
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


def space_at_start(world: IslandWorld, schedule: Schedule) -> Space:
    """A space at step 0: that of an ended episode in such a world, or a new one."""
    idle = idle_spaces(world, schedule.obstacles, len(schedule.humanoids))
    space = idle.pop() if idle else _built(world, schedule, idle)
    motion = schedule.humanoids[["x", "y", "vx", "vy"]].tolist()
    space.reset([(*world.start, 0.0, 0.0), *motion])
    return space


def _built(world: IslandWorld, schedule: Schedule, idle: list[Space]) -> Space:
    """A new space; `idle` gets it after its episode."""
    space, contacts = pymunk.Space(), Contacts(len(schedule.humanoids))
    corners = [(-WALL, -WALL), (world.side + WALL, -WALL)]
    corners += [(world.side + WALL, world.side + WALL), (-WALL, world.side + WALL)]
    static: list[pymunk.Shape] = [
        pymunk.Segment(space.static_body, a, b, WALL)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    ]
    static += [pymunk.Circle(space.static_body, r, (x, y)) for x, y, r in schedule.obstacles]
    for i, shape in enumerate(static):
        shape.elasticity = 1.0
        shape.collision_type = STATIC
        contacts.index[shape] = -1 - i
    space.add(*static)
    robot = pymunk.Body(ROBOT_MASS, float("inf"))
    hull = pymunk.Circle(robot, world.robot.radius)
    hull.collision_type = ROBOT
    movers: list[tuple[pymunk.Body, pymunk.Shape]] = [(robot, hull)]
    for i in range(len(schedule.humanoids)):
        body = pymunk.Body(HUMANOID_MASS, float("inf"))
        shape = pymunk.Circle(body, world.humanoids.radius)
        shape.elasticity = 1.0
        shape.collision_type = HUMANOID
        shape.filter = pymunk.ShapeFilter(group=HUMANOID_GROUP)
        contacts.index[shape] = i
        movers.append((body, shape))
    space.add(*(thing for mover in movers for thing in mover))
    for kind in (HUMANOID, STATIC):
        space.on_collision(ROBOT, kind, begin=contacts.begin, separate=contacts.separate)
    return Space(space, tuple(movers), contacts, idle)
