"""The peer's episode: sense, write the blackboard, tick, step; 4,200 times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from py_trees.behaviour import Behaviour
from py_trees.blackboard import Blackboard, Client
from py_trees.common import Access
from py_trees.trees import BehaviourTree

from benchmarks.peer.actions import ACTIONS
from benchmarks.peer.island import Island
from islandgp.bt.core.node import Node
from islandgp.bt.export.py_trees import to_python
from islandgp.domains.island.events import Award
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import IslandWorld


@dataclass(frozen=True, slots=True)
class PeerEpisode:
    """What happened."""

    fitness: float  # points
    counts: dict[str, int]  # events by kind
    steps: int


def create_tree(tree: Node, action: Callable[[str], Behaviour]) -> Behaviour:
    """The tree in py_trees, as `islandgp export` writes it; `action(name)` makes a leaf."""
    module: dict[str, Callable[[Callable[[str], Behaviour]], Behaviour]] = {}
    exec(to_python(tree, VOCABULARY), module)
    return module["create_tree"](action)


def run_peer_episode(tree: Node, world: IslandWorld, seed: int, award: Award) -> PeerEpisode:
    """The episode of `run_episode`, step by step."""
    Blackboard.clear()
    root = BehaviourTree(create_tree(tree, lambda name: ACTIONS[name](name)))
    island = Island(world, seed, award)
    root.setup(island=island)
    board = Client(name="robot")
    for key in VOCABULARY.keys:
        board.register_key(key, access=Access.WRITE)
    while not _over(island):
        island.sense()
        board.batteryLevel = island.battery
        board.robotCurrentExtraCapacity = world.robot.capacity - island.load
        board.lap = island.laps
        board.foundGarbage = island.found_garbage
        board.isHumanoidWantToClear = island.asked
        island.goal = None
        island.patrolling = island.acted = island.charging = False
        root.tick()
        island.turn_wheels()
        island.pass_time()
    island.log("leftover", len(island.garbage))
    counts = Counter(event for _, event, _ in island.event_log.events)
    return PeerEpisode(island.event_log.fitness, dict(counts), island.step)


def _over(island: Island) -> bool:
    """Whether the episode has come to an end."""
    limits, event_log, dt = island.world.episode, island.event_log, island.dt
    if island.battery <= 1e-9:
        island.log("shutdown", 1)
        return True
    low = island.battery < limits.low_battery
    patience = limits.stagnation_low_battery if low else limits.stagnation
    since = event_log.negative_since
    return (
        island.step >= round(limits.length / dt)
        or island.step - event_log.best_step >= round(patience / dt)
        or (since >= 0 and island.step - since >= round(limits.negative / dt))
    )
