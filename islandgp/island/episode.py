"""An episode: one robot with one tree on one day of the island (section 2.2.2).

Time goes in steps of a tenth of a second. A step at which nothing can change
is left to the physics engine alone: everybody who could change something tells
from which step on, and the loop goes there in one go. `stepwise=True` looks at
everything in every step instead; the outcome is the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

from islandgp.bt.engine import compile_tree, thresholds
from islandgp.bt.node import RUNNING, Node
from islandgp.island.actions import ACTIONS
from islandgp.island.journal import Award, Event
from islandgp.island.passing import advance
from islandgp.island.robot import FAR, MICRO
from islandgp.island.sensing import sense
from islandgp.island.state import Island
from islandgp.island.world import World


class Ending(StrEnum):
    """Why an episode ended."""

    TIME = "time"  # 420 s are over
    STAGNATION = "stagnation"  # no better fitness for 120 s (180 s with a low battery)
    NEGATIVE = "negative"  # fitness below zero for 60 s
    SHUTDOWN = "shutdown"  # the battery is empty


@dataclass(frozen=True, slots=True)
class Episode:
    """What happened in an episode."""

    events: tuple[tuple[int, Event, float], ...]  # (step, event, amount), in order
    steps: int  # simulated steps, >= 1
    ending: Ending
    fitness: float  # points of all events
    battery: float  # % at the end
    distance: float  # m driven
    inactive: float  # s since the last non-movement action
    laps: int  # patrol rounds finished
    ticks: int  # how often the tree was ticked; a cost, not a result


def run_episode(
    tree: Node,
    world: World,
    seed: int,
    award: Award,
    *,
    stepwise: bool = False,
    watch: Callable[[int, int], None] | None = None,
    observe: Callable[[Island], None] | None = None,
) -> Episode:
    """Runs `tree` in the world of `seed`; a function of its first four arguments alone.

    `watch(node, status)` sees every ticked node, `observe(island)` the island
    after every tick; both want `stepwise=True` to see each step.
    """
    island = Island(world, seed, award, thresholds(tree, "batteryLevel"))
    actions = {name: partial(action, island) for name, action in ACTIONS.items()}
    tick = compile_tree(tree, actions, island.board, watch=watch)
    ticks = idle = 0
    ending: Ending | None = None
    while ending is None:
        sense(island, always=stepwise)
        status = _tick(island, tick)
        ticks += 1
        if observe is not None:
            observe(island)
        start = island.step
        advance(island, start + 1 if stepwise or status != RUNNING else _horizon(island))
        idle = _account(island, island.step - start, idle)
        ending = _ending(island)
    return _close(island, ending, ticks)


def _tick(island: Island, tick: Callable[[], int]) -> int:
    """One tick of the tree, with the wheels stopped if nobody drives."""
    robot = island.robot
    robot.driving = robot.charging = island.acted = island.patrolling = False
    island.wake = FAR
    status = tick()
    if not robot.driving:
        robot.stand()
    return status


def _horizon(island: Island) -> int:
    """The earliest step at which anything but the physics can change something."""
    return min(
        island.wake,
        island.ground.due,
        island.humanoids.due,
        island.robot.battery_due(island.step),
        _deadline(island),
    )


def _deadline(island: Island) -> int:
    """The step at which the episode ends if nothing happens."""
    limits, journal = island.limits, island.journal
    low = island.robot.battery < limits.low_battery
    end = journal.best_step + (limits.stagnation_low_battery if low else limits.stagnation)
    if journal.negative_since >= 0:
        end = min(end, journal.negative_since + limits.negative)
    return min(end, limits.length)


def _account(island: Island, steps: int, idle: int) -> int:
    """Books `steps` steps that have passed; returns the steps of idleness so far.

    Idle is who neither drives nor acts. Such a robot is ticked in each step.
    """
    robot = island.robot
    robot.spend(steps)
    if island.patrolling:
        island.patrol_steps += steps
    if robot.charging:
        island.last_action = island.step
    if robot.driving or island.acted:
        return 0
    idle += steps
    if idle % island.limits.second == 0:
        island.log(Event.IDLE, idle / island.limits.second)
    return idle


def _ending(island: Island) -> Ending | None:
    if island.robot.battery <= 0:
        island.log(Event.SHUTDOWN, 1)
        return Ending.SHUTDOWN
    if island.step < _deadline(island):
        return None
    if island.step >= island.limits.length:
        return Ending.TIME
    since, limit = island.journal.negative_since, island.limits.negative
    return Ending.NEGATIVE if 0 <= since <= island.step - limit else Ending.STAGNATION


def _close(island: Island, ending: Ending, ticks: int) -> Episode:
    island.log(Event.LEFTOVER, island.ground.count)
    step = island.world.episode.step
    return Episode(
        events=tuple(island.journal.events),
        steps=island.step,
        ending=ending,
        fitness=island.journal.fitness,
        battery=max(0, island.robot.battery) / MICRO,
        distance=island.robot.odometer * island.robot.stride,
        inactive=(island.step - island.last_action) * step,
        laps=island.robot.laps,
        ticks=ticks,
    )
