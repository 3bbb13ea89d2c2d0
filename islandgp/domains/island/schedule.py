"""The schedule of a world, drawn from its seed: positions of things and times of events.

It does not depend on the robot, so it is drawn once and shared by all episodes in the same world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, cos, hypot, sin, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from islandgp.domains.island.fields import HUMANOID, ITEM, TURN
from islandgp.domains.island.world import FAR, IslandWorld
from islandgp.errors import ConfigError

Circle = tuple[float, float, float]  # x, y, radius in metres
Table = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Schedule:
    """The events of one world seed, drawn before its episodes; its tables are not changed."""

    obstacles: tuple[Circle, ...]
    garbage: Table  # ITEM: all of the episode, those at the start first
    initial: int  # number of items at the start
    humanoids: Table  # HUMANOID, at the start
    spawns: Table  # steps in which the other items appear; the last is FAR
    turns: Table  # TURN, by step; the step of the last is FAR
    cell_starts: Table  # where each cell begins in `cell_items`
    cell_items: Table  # of each cell: the items in it and in the eight around it
    columns: int  # cells in a row, including empty ones at the margin


def schedule_of(
    world: IslandWorld,
    *,
    obstacles: tuple[Circle, ...],
    garbage: Sequence[Sequence[float]],
    spawns: Sequence[tuple[int, float, float]],
    humanoids: Sequence[tuple[float, float, float, float]],
    turns: Sequence[tuple[int, int, float, float]],
) -> Schedule:
    """Makes a schedule.

    Args:
        world: the settings of its island.
        obstacles: rocks and trees.
        garbage: x and y of the items at the start, in metres.
        spawns: step, x and y of the items that appear, by step.
        humanoids: x, y, vx and vy of each humanoid at the start.
        turns: step, humanoid, vx and vy: it turns and finds one more item; by step.
    """
    items = np.zeros(len(garbage) + len(spawns), ITEM)
    places = np.array([*garbage, *(spawn[1:] for spawn in spawns)]).reshape(-1, 2)
    items["x"], items["y"] = places.T
    items["present"][: len(garbage)] = 1
    people = np.zeros(len(humanoids), HUMANOID)
    for name, values in zip(("x", "y", "vx", "vy"), zip(*humanoids, strict=True), strict=False):
        people[name] = values
    people["unseen"] = 1
    columns = ceil(world.side / world.cell) + 2
    lowest = (places // world.cell).astype(np.int64) @ [1, columns]  # of the nine around each
    around = np.array([row * columns + i for row in range(3) for i in range(3)])
    cells = (lowest[:, None] + around).ravel()
    return Schedule(
        obstacles=obstacles,
        garbage=items,
        initial=len(garbage),
        humanoids=people,
        spawns=np.array([*(spawn[0] for spawn in spawns), FAR]),
        turns=np.array([*turns, (FAR, 0, 0.0, 0.0)], TURN),
        cell_starts=np.searchsorted(np.sort(cells), np.arange(columns**2 + 1)),
        cell_items=np.argsort(cells, kind="stable") // len(around),
        columns=columns,
    )


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
) -> list[list[float]]:
    """`n` points of free ground, at least `clear` metres from obstacles and walls."""
    rocks = np.array(obstacles(world)).reshape(-1, 3)
    places: list[list[float]] = []
    for _ in range(1000):
        if len(places) >= n:
            return places[:n]
        points = rng.uniform(clear, world.side - clear, (n + 8, 2))
        gaps = np.hypot(points[:, :1] - rocks[:, 0], points[:, 1:] - rocks[:, 1])
        free = (gaps > rocks[:, 2] + clear).all(axis=1)
        places += points[free].tolist()
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
    return schedule_of(
        world,
        obstacles=obstacles(world),
        garbage=garbage,
        spawns=[(step, x, y) for step, (x, y) in zip(spawning, spawned, strict=True)],
        humanoids=[(x, y, *v) for (x, y), v in zip(starts, first, strict=True)],
        turns=turns,
    )


def _velocity(speed: float, angle: float) -> tuple[float, float]:
    return speed * cos(angle), speed * sin(angle)
