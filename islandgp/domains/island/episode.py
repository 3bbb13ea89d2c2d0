"""An episode: one robot with one tree on one day of the island (section 2.2.2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import cache, partial

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.kinds import needs_each_tick
from islandgp.bt.core.node import compares_keys, thresholds, walk
from islandgp.domain import FAILURE, Node, Sensors
from islandgp.domains.island import engine
from islandgp.domains.island.events import Award
from islandgp.domains.island.state import State
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import IslandWorld


@cache
def compile_engine(world: IslandWorld) -> None:
    """Compiles the functions that an episode calls, or loads their machine code."""
    island = State(world, 0, lambda _event, _amount: ("", 0.0))
    engine.proceed(island.record, FAILURE)
    island.perform(0, False, True)


def run_episode(
    tree: Node,
    world: IslandWorld,
    seed: int,
    award: Award,
    *,
    stepwise: bool = False,
    watch: Callable[[int, int], None] | None = None,
    observe: Callable[[State], None] | None = None,
    sensors: Sensors | None = None,
) -> State:
    """The island after an episode, a function of tree, world, seed and award.

    Args:
        tree: the robot's tree.
        world: settings of the island.
        seed: of the world.
        award: component and points by event.
        stepwise: check every part in every step.
        watch: called with the index and status of every ticked node.
        observe: called with the island after every tick. Like `watch`, it needs `stepwise` to be
            called in each step.
        sensors: the tree reads their values in place of the true blackboard; implies `stepwise`.
    """
    stepwise = stepwise or sensors is not None
    # Such a tree is ticked in every step; the battery is the only key that moves all the time.
    timed = needs_each_tick(tree) or compares_keys(tree, "batteryLevel")
    may_coast = engine.ADDS_AS_CHIPMUNK and not (stepwise or watch or observe)
    while True:
        island = State(
            world,
            seed,
            award,
            thresholds(tree, "batteryLevel"),
            stepwise=stepwise,
            timed=timed,
            may_coast=may_coast,
        )
        board = island.board if sensors is None else island.board.tolist()
        bound, step_s = _bound_actions(tree, island), world.episode.step
        keys = VOCABULARY.key_index
        tick = compile_tree(tree, bound, board, keys, watch=watch, step_s=step_s, seed=seed)
        status = FAILURE
        while (task := engine.proceed(island.record, status)) < engine.ENDED:
            island.count_events()
            if task == engine.TICK:
                if sensors is not None:
                    board[:] = sensors(island.board)
                status = tick()
                if observe is not None:
                    observe(island)
        island.physics.idle.append(island.physics)
        if task == engine.ENDED:
            if island.ending == "shutdown":
                island.log("shutdown", 1)
            island.log("leftover", int(island.garbage["present"].sum()))
            return island
        may_coast = False  # two contacts of one body: the episode is repeated


def _bound_actions(tree: Node, island: State) -> dict[str, Callable[[bool], int]]:
    """The actions of this island's robot.

    All leaves of one action share its goal: one that starts may change it for another that runs.
    """
    leaves = Counter(node.action for node in walk(tree) if node.action)
    numbers = {name: number for number, name in enumerate(VOCABULARY.actions)}
    return {
        name: partial(island.perform, numbers[name], count > 1) for name, count in leaves.items()
    }
