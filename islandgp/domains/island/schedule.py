"""The schedule of a world, drawn from its seed: positions of things and times of events.

It does not depend on the robot, so it is drawn once and shared by all episodes in the same world.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import cos, hypot, sin, tau

import numpy as np

from islandgp.domains.island.world import FAR, IslandWorld
from islandgp.errors import ConfigError

Circle = tuple[float, float, float]  # x, y, radius in metres
Spawn = tuple[int, float, float]  # (step, x, y): an item of garbage appears
Turn = tuple[int, int, float, float]  # (step, humanoid, vx, vy): it turns and finds one more item


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """The events of one world seed, drawn before its episodes."""

    obstacles: tuple[Circle, ...]
    garbage: tuple[complex, ...]  # positions at the start, x + iy
    humanoids: tuple[tuple[float, float, float, float], ...]  # x, y, vx, vy at the start
    # Events by step. The last of each has the step FAR, which no episode reaches.
    spawns: tuple[Spawn, ...]
    turns: tuple[Turn, ...]


@lru_cache(maxsize=8)
def obstacles(world: IslandWorld) -> tuple[Circle, ...]:
    """Rocks and trees, apart from each other and from every place the robot must reach.

    Raises ConfigError if they do not fit on the island.
    """
    rng = np.random.default_rng(world.obstacles.layout_seed)
    keep = [
        (*p, 0.0) for p in (world.start, *world.chargers, *world.clearing_points, *world.waypoints)
    ]
    placed: list[Circle] = []
    low, high = world.obstacles.radius
    for _ in range(1000 * world.obstacles.count):
        if len(placed) == world.obstacles.count:
            break
        radius = float(rng.uniform(low, high))
        border = radius + world.obstacles.gap
        if 2 * border >= world.side:
            break
        x, y = (float(v) for v in rng.uniform(border, world.side - border, 2))
        if all(hypot(x - cx, y - cy) > radius + r + world.obstacles.gap for cx, cy, r in keep):
            placed.append((x, y, radius))
            keep.append((x, y, radius))
    if len(placed) < world.obstacles.count:
        raise ConfigError(
            f"world.obstacles: expected room for {world.obstacles.count} obstacles,"
            f" found room for {len(placed)}; lower count, radius or gap."
        )
    return tuple(placed)


def _free_points(
    world: IslandWorld, rng: np.random.Generator, n: int, clear: float
) -> list[complex]:
    """`n` points of free ground, at least `clear` metres from obstacles and walls."""
    rocks = np.array(obstacles(world)).reshape(-1, 3)
    places: list[complex] = []
    for _ in range(1000):
        if len(places) >= n:
            return places[:n]
        points = rng.uniform(clear, world.side - clear, (n + 8, 2))
        gaps = np.hypot(points[:, :1] - rocks[:, 0], points[:, 1:] - rocks[:, 1])
        free = (gaps > rocks[:, 2] + clear).all(axis=1)
        places += [complex(x, y) for x, y in points[free]]
    raise ConfigError(
        f"world: expected free ground for {n} things, found almost none; lower obstacles.count."
    )


@lru_cache(maxsize=32)  # more than the worlds to which the races of a run return
def draw_schedule(world: IslandWorld, seed: int) -> Schedule:
    """The schedule of `seed`, a function of the arguments."""
    rng = np.random.default_rng(seed)
    clear = world.robot.radius + world.robot.pickup_reach
    steps = round(world.episode.length / world.episode.step)
    every = max(1, round(world.garbage.every / world.episode.step))
    spawning = range(every, steps + 1, every)
    garbage = _free_points(world, rng, world.garbage.initial, clear)
    spawned = _free_points(world, rng, len(spawning), clear)
    people = world.humanoids
    starts = _free_points(world, rng, people.count, people.radius + 2 * world.robot.radius)
    first = [_velocity(people.speed, a) for a in rng.uniform(0, tau, people.count)]
    low, high = (max(1, round(s / world.episode.step)) for s in people.turn_every)
    most = steps // low + 1
    turn_steps = rng.integers(low, high + 1, (people.count, most)).cumsum(axis=1)
    angles = rng.uniform(0, tau, (people.count, most))
    turns = sorted(
        (step, h, *_velocity(people.speed, angle))
        for h in range(people.count)
        for step, angle in zip(turn_steps[h].tolist(), angles[h].tolist(), strict=True)
        if step <= steps
    )
    return Schedule(
        obstacles=obstacles(world),
        garbage=tuple(garbage),
        humanoids=tuple((z.real, z.imag, *v) for z, v in zip(starts, first, strict=True)),
        spawns=(
            *((s, z.real, z.imag) for s, z in zip(spawning, spawned, strict=True)),
            (FAR, 0.0, 0.0),
        ),
        turns=(*turns, (FAR, 0, 0.0, 0.0)),
    )


def _velocity(speed: float, angle: float) -> tuple[float, float]:
    return speed * cos(angle), speed * sin(angle)
