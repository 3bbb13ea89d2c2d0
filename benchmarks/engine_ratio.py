"""An episode over the bare physics: what sensing, deciding and book-keeping add to Chipmunk."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time
from typing import Final

from benchmarks.figure import Effort, Figure, at_most
from benchmarks.pinned import endless, example, points, settings
from benchmarks.turns import medians, ratio, turns
from islandgp.domains.island.episode import run_episode
from islandgp.domains.island.schedule import draw_schedule
from islandgp.domains.island.space import space_at_start
from islandgp.domains.island.world import IslandWorld

SEEDS: Final = {Effort.TINY: 1, Effort.QUICK: 3, Effort.FULL: 6}
ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 5, Effort.FULL: 12}  # of each seed


def measure(effort: Effort) -> list[Figure]:
    """Pairs of one episode of the all-rounder and as many bare steps in the same world."""
    world = endless_world(effort)
    rows = pairs(effort, world, episode_of)
    usual, bare = medians(rows)
    steps = f"{steps_of(world):,}"
    return [
        Figure(
            "engine_ratio",
            ratio(rows, 0, 1),
            "",
            f"all-rounder's episode of {steps} steps / the bare steps; median over pairs",
            at_most(1.2),
        ),
        Figure("engine_ratio_of_medians", usual / bare, "", "the same, median over median"),
        Figure("episode_ms", 1000 * usual, "ms", "the episode, from world and tree to outcome"),
        Figure("bare_ms", 1000 * bare, "ms", "the bare steps; the robot bounces about at 5 m/s"),
    ]


def endless_world(effort: Effort) -> IslandWorld:
    """The default world without early endings; short with the least effort."""
    world = endless(settings().world)
    return endless(world, episode={"length": 10}) if effort is Effort.TINY else world


def steps_of(world: IslandWorld) -> int:
    """Steps of an episode."""
    return round(world.episode.length / world.episode.step)


def pairs(
    effort: Effort, world: IslandWorld, side: Callable[[IslandWorld, int], Callable[[], object]]
) -> list[tuple[float, ...]]:
    """CPU seconds of an episode and of as many bare steps; `side` makes the episode of a seed."""
    rows, steps = [], steps_of(world)
    for seed in range(SEEDS[effort]):
        episode = run_episode(example("all_rounder"), world, seed, points())
        assert episode.step == steps, f"seed {seed} ended after {episode.step} steps"
        for _ in range(ROUNDS[effort]):
            rows += turns([side(world, seed), _bare(world, seed, steps)], 1, clock=process_time)
    return rows


def episode_of(world: IslandWorld, seed: int) -> Callable[[], object]:
    """An episode of the all-rounder."""
    tree, award = example("all_rounder"), points()
    return lambda: run_episode(tree, world, seed, award)


def _bare(world: IslandWorld, seed: int, steps: int) -> Callable[[], object]:
    """The same space with everybody in motion, and nobody who looks."""
    physics = space_at_start(world, draw_schedule(world, seed))
    robot = physics.bodies[0]
    for shape in robot.shapes:
        shape.elasticity = 1.0
    robot.velocity = (0.6 * world.robot.speed, 0.8 * world.robot.speed)
    step, dt = physics.space.step, world.episode.step

    def run() -> None:
        for _ in range(steps):
            step(dt)

    return run
