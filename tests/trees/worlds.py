"""Random trees of the evolution's kind, and what they do on the island tick by tick."""

from __future__ import annotations

from typing import TypeAlias

from islandgp.bt.engine import ABORTED
from islandgp.bt.node import Node, walk
from islandgp.evolution.generation import random_tree
from islandgp.island.episode import Episode, run_episode
from islandgp.island.state import Island
from islandgp.scoring.rewards import award
from islandgp.seeding import Stream, stream
from islandgp.settings import Settings

Tick: TypeAlias = tuple[tuple[tuple[str, bool, int], ...], tuple[str, ...], int]
Trace: TypeAlias = list[Tick]  # per tick: calls (action, fresh, status), aborted actions, status


def random_trees(settings: Settings, count: int) -> list[Node]:
    """The random trees of a run with seed 0; every second one is a larger tree than usual."""
    usual = settings.gp.trees
    large = usual.model_copy(update={"depth": (4, 7), "leaf": 0.2})
    limits = settings.gp.limits
    return [
        random_tree(stream(0, Stream.INITIAL, slot=i), large if i % 2 else usual, limits)
        for i in range(count)
    ]


def island_trace(
    settings: Settings, tree: Node, seed: int, seconds: float
) -> tuple[list[list[tuple[str, int]]], Episode]:
    """Per tick the actions with their statuses, and the whole episode with its events."""
    leaves = {i: str(n.args[0]) for i, n in enumerate(walk(tree)) if n.kind == "action"}
    ticks: list[list[tuple[str, int]]] = []
    called: list[tuple[str, int]] = []
    aborted: list[tuple[str, int]] = []

    def watch(place: int, status: int) -> None:
        if place in leaves:
            (aborted if status == ABORTED else called).append((leaves[place], status))

    def observe(_: Island) -> None:
        ticks.append([*called, *sorted(aborted)])
        called.clear()
        aborted.clear()

    world = settings.world
    episode = world.episode.model_copy(update={"length": seconds})
    points = award(settings.rewards, settings.curriculum.multipliers(3))
    world = world.model_copy(update={"episode": episode})
    result = run_episode(tree, world, seed, points, stepwise=True, watch=watch, observe=observe)
    return ticks, result
