"""A batch of the peer's episodes through DEAP: a toolbox whose `map` is that of a pool."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from multiprocessing.pool import Pool
from typing import Any

from deap import base, creator  # type: ignore[import-untyped]  # it has no types

from benchmarks.peer.episode import run_peer_episode
from benchmarks.pinned import points
from islandgp.bt.core.language import parse
from islandgp.domains.island.world import IslandWorld

creator.create("Fitness", base.Fitness, weights=(1.0,))
creator.create("Individual", list, fitness=creator.Fitness)

_world: IslandWorld | None = None  # a worker's own copy


def start(world: IslandWorld) -> None:
    """What each worker of the pool gets once."""
    global _world
    _world = world


def evaluate(individual: Sequence[Any]) -> tuple[float]:
    """DEAP's evaluation function: a tuple of one fitness."""
    assert _world is not None
    text, seed = individual
    return (run_peer_episode(parse(text), _world, seed, points()).fitness,)


def pool(workers: int, world: IslandWorld) -> Pool:
    """The processes."""
    return multiprocessing.get_context("spawn").Pool(workers, start, (world,))


def toolbox(workers: Pool) -> Any:
    """DEAP's toolbox, with the pool's map as its documentation has it."""
    box = base.Toolbox()
    box.register("evaluate", evaluate)
    box.register("map", workers.map)
    return box


def run_batch(box: Any, jobs: Sequence[tuple[str, int]]) -> list[float]:
    """The fitness of each (tree, seed): DEAP's idiom for all whose fitness is not valid yet."""
    population = [creator.Individual(job) for job in jobs]
    invalid = [individual for individual in population if not individual.fitness.valid]
    for individual, fitness in zip(invalid, box.map(box.evaluate, invalid), strict=True):
        individual.fitness.values = fitness
    return [individual.fitness.values[0] for individual in population]
