"""How costs grow with what there is: nothing may grow faster than the number of things."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import log
from statistics import median
from time import process_time
from typing import Final, NamedTuple

from benchmarks.figure import Effort, Figure
from benchmarks.pinned import SEED, endless, example, points, settings
from benchmarks.turns import medians, turns
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size
from islandgp.domains.island.episode import run_episode
from islandgp.domains.island.world import IslandWorld
from islandgp.evaluation.base import Problem
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evolve
from islandgp.running.parts import make_supervisor

ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 2, Effort.FULL: 3}
DOUBLINGS: Final = {Effort.TINY: 1, Effort.QUICK: 3, Effort.FULL: 4}
SEEDS: Final = {Effort.TINY: 1, Effort.QUICK: 2, Effort.FULL: 3}
GENERATIONS: Final = {Effort.TINY: 2, Effort.QUICK: 4, Effort.FULL: 8}
LINEAR: Final = 1.15  # the largest exponent that passes for linear: timing has noise


class Growth(NamedTuple):
    """The cost at sizes that double."""

    sizes: list[int]
    seconds: list[float]

    @property
    def per_item(self) -> float:
        """Seconds that one thing more costs, over the last doubling."""
        return (self.seconds[-1] - self.seconds[-2]) / (self.sizes[-1] - self.sizes[-2])

    @property
    def exponent(self) -> float:
        """The power of the last doubling: 0 costs nothing, 1 is linear."""
        factor = self.seconds[-1] / self.seconds[-2]
        return log(factor) / log(self.sizes[-1] / self.sizes[-2])


def measure(effort: Effort) -> list[Figure]:
    """Garbage, humanoids and nodes in an episode; individuals in a generation's operators."""
    length = 5 if effort is Effort.TINY else settings().world.episode.length
    world = endless(endless(settings().world, episode={"length": length}))
    growths = {
        "garbage": (_garbage(world, effort), "an episode's us for an item of garbage more"),
        "humanoid": (_humanoids(world, effort), "an episode's us for a humanoid more"),
        "node": (_nodes(world, effort), "an episode's us for a node more"),
        "individual": (
            _population(effort),
            "us for an individual more, of a generation's operators and supervisor",
        ),
    }
    figures = []
    for name, (growth, meaning) in growths.items():
        span = f"{growth.sizes[-2]} to {growth.sizes[-1]}"
        figures += [
            Figure(f"per_{name}_us", 1e6 * growth.per_item, "us", f"{meaning}, {span}"),
            Figure(
                f"per_{name}_power",
                growth.exponent,
                "",
                f"the power of that growth, from {growth.seconds[-2] * 1000:.1f}"
                f" to {growth.seconds[-1] * 1000:.1f} ms",
                warning="faster than linear" if growth.exponent > LINEAR else "",
            ),
        ]
    return figures


def _doubling(first: int, effort: Effort) -> list[int]:
    return [first * 2**i for i in range(DOUBLINGS[effort] + 1)]


def _garbage(world: IslandWorld, effort: Effort) -> Growth:
    sizes = _doubling(world.garbage.initial, effort)
    worlds = [endless(world, garbage={"initial": n, "most": n + 30}) for n in sizes]
    return _episodes(sizes, [example("all_rounder")] * len(sizes), worlds, effort)


def _humanoids(world: IslandWorld, effort: Effort) -> Growth:
    sizes = _doubling(world.humanoids.count, effort)
    worlds = [endless(world, humanoids={"count": n}) for n in sizes]
    return _episodes(sizes, [example("all_rounder")] * len(sizes), worlds, effort)


def _nodes(world: IslandWorld, effort: Effort) -> Growth:
    trees = [_wide_tree(n) for n in _doubling(24, effort)]
    return _episodes([size(tree) for tree in trees], trees, [world] * len(trees), effort)


def _wide_tree(nodes: int) -> Node:
    """Work for the robot, behind guards that are asked in each tick and never hold."""
    guards = " ".join(
        f"when batteryLevel < -{i} {{ MoveToHumanoid }}" for i in range((nodes - 6) // 2)
    )
    work = "when foundGarbage { sequence { MoveToGarbage PickupGarbage } } PatrolWaypoint"
    return parse(f"selector {{ {guards} {work} }}")


def _episodes(
    sizes: Sequence[int], trees: Sequence[Node], worlds: Sequence[IslandWorld], effort: Effort
) -> Growth:
    """Seconds of the same simulated time, for the same seeds at each size."""
    award, seeds = points(), range(SEEDS[effort])

    def side(tree: Node, world: IslandWorld) -> Callable[[], object]:
        return lambda: [run_episode(tree, world, seed, award) for seed in seeds]

    sides = [side(tree, world) for tree, world in zip(trees, worlds, strict=True)]
    steps = [
        sum(run_episode(tree, world, seed, award).step for seed in seeds)
        for tree, world in zip(trees, worlds, strict=True)
    ]
    planned = round(worlds[0].episode.length / worlds[0].episode.step)
    seconds = medians(turns(sides, ROUNDS[effort], clock=process_time))
    return Growth(list(sizes), [s * planned / n for s, n in zip(seconds, steps, strict=True)])


def _population(effort: Effort) -> Growth:
    sizes = _doubling(30, effort)
    return Growth(sizes, [_operators(n, effort) for n in sizes])


def _operators(population: int, effort: Effort) -> float:
    """Seconds of a generation without its episodes, which are kept short."""
    chosen = settings(
        "search=paper",
        f"gp.population={population}",
        f"gp.generations={GENERATIONS[effort]}",
        "world.episode.length=1",
    )
    domain = chosen.make_domain()
    evaluator = Serial(Problem(domain, chosen.curriculum))
    steps = evolve(chosen.plan(domain), SEED, make_supervisor(chosen, None), evaluator)
    costs = [step.cost for step in steps][:-1]  # the last generation has no successor
    return median(cost.operators + cost.supervision for cost in costs)
