"""Records an episode tick by tick: what happened on the island and in the tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from islandgp.bt.engine import ABORTED
from islandgp.bt.node import AGAIN, FAILURE, RUNNING, SUCCESS, Node, size
from islandgp.island.episode import Episode, run_episode
from islandgp.island.garbage import Item
from islandgp.island.journal import Event
from islandgp.island.script import obstacles
from islandgp.island.state import Island
from islandgp.island.world import World
from islandgp.scoring.curriculum import Curriculum
from islandgp.scoring.rewards import TABLE_3, Component, Rewards, award

IDLE, FAILED, SUCCEEDED, RUNS, STOPPED = range(5)
"""What a node did in a tick: nothing, or the last thing that it was told or told."""

_CODES = {FAILURE: FAILED, SUCCESS: SUCCEEDED, RUNNING: RUNS, AGAIN: RUNS, ABORTED: STOPPED}

Stay = tuple[float, float, int, int]
"""Of garbage: x, y in metres, the tick from which it lies there, and the one when it is gone."""


class Surroundings(Protocol):
    """What an episode needs beside its tree: `Settings` of a run has it, and so has `Setting`."""

    @property
    def world(self) -> World:
        """The island."""
        ...

    @property
    def rewards(self) -> Rewards:
        """Table 3."""
        ...

    @property
    def curriculum(self) -> Curriculum:
        """Table 2."""
        ...


@dataclass(frozen=True, slots=True)
class Credit:
    """An event with what it was worth."""

    tick: int
    event: Event
    amount: float
    component: Component
    points: float


@dataclass(frozen=True, slots=True)
class Recording:
    """One episode. A tick is a step of the physics; there are `ticks` of them."""

    tree: Node
    world: World
    seed: int
    stage: int  # index into Table 2
    ticks: int
    rocks: tuple[tuple[float, float, float], ...]  # x, y, radius in metres
    statuses: tuple[bytes, ...]  # per node in document order, a code per tick
    counts: tuple[tuple[int, int, int, int, int], ...]  # per node and code: how often; [0] is 0
    robot: tuple[complex, ...]  # x + iy in metres, per tick
    goals: tuple[complex | None, ...]  # where it drives to, per tick
    humanoids: np.ndarray  # x + iy in metres, shape (ticks, humanoids)
    carried: tuple[tuple[int, ...], ...]  # items of each humanoid, per tick
    garbage: tuple[Stay, ...]
    boards: tuple[tuple[float, ...], ...]  # the blackboard in the order of KEYS, per tick
    credits: tuple[Credit, ...]
    episode: Episode

    @property
    def seconds(self) -> float:
        """Simulated seconds."""
        return self.ticks * self.world.episode.step


def record(tree: Node, surroundings: Surroundings, *, seed: int, stage: int) -> Recording:
    """Runs a tree in the world of `seed`, scored as in the stage of that index, and records it."""
    worth = award(surroundings.rewards, surroundings.curriculum.multipliers(stage))
    recorder = _Recorder(tree)
    episode = run_episode(
        tree,
        surroundings.world,
        seed,
        worth,
        stepwise=True,
        watch=recorder.watch,
        observe=recorder.observe,
    )
    ticks = len(recorder.robot)
    return Recording(
        tree=tree,
        world=surroundings.world,
        seed=seed,
        stage=stage,
        ticks=ticks,
        rocks=obstacles(surroundings.world),
        statuses=tuple(bytes(line) for line in recorder.statuses),
        counts=tuple((c[0], c[1], c[2], c[3], c[4]) for c in recorder.counts),
        robot=tuple(recorder.robot),
        goals=tuple(recorder.goals),
        humanoids=np.array(recorder.humanoids, dtype=complex).reshape(
            ticks, surroundings.world.humanoids.count
        ),
        carried=tuple(recorder.carried),
        garbage=tuple(recorder.stays(ticks)),
        boards=tuple(recorder.boards),
        credits=tuple(
            Credit(
                min(step, ticks - 1),
                event,
                amount,
                TABLE_3[event][0],
                worth(event, amount),
            )
            for step, event, amount in episode.events
        ),
        episode=episode,
    )


class _Recorder:
    """Collects what the episode shows of itself."""

    def __init__(self, tree: Node) -> None:
        nodes = size(tree)
        self.statuses = [bytearray() for _ in range(nodes)]
        self.counts = [[0] * 5 for _ in range(nodes)]
        self.robot: list[complex] = []
        self.goals: list[complex | None] = []
        self.humanoids: list[list[complex]] = []
        self.carried: list[tuple[int, ...]] = []
        self.boards: list[tuple[float, ...]] = []
        self._now: dict[int, int] = {}  # codes of this tick by node
        self._lying: dict[Item, int] = {}  # since when
        self._gone: list[Stay] = []

    def watch(self, place: int, status: int) -> None:
        """A node was ticked or aborted."""
        code = _CODES[status]
        self.counts[place][code] += 1
        self._now[place] = code

    def observe(self, island: Island) -> None:
        """A tick is over."""
        for place, line in enumerate(self.statuses):
            line.append(self._now.get(place, IDLE))
        self._now.clear()
        robot, people = island.robot, island.humanoids
        self._see_garbage(island.ground.items(), len(self.robot))
        self.robot.append(complex(robot.x, robot.y))
        self.goals.append(complex(*robot.wish[:2]) if robot.driving else None)
        self.humanoids.append(island.physics.humanoid_positions())
        self.carried.append(tuple(people.items))
        self.boards.append(tuple(map(float, island.board)))

    def stays(self, ticks: int) -> list[Stay]:
        """All garbage, by the tick of its appearance."""
        left = [(item.x, item.y, since, ticks) for item, since in self._lying.items()]
        return sorted([*self._gone, *left], key=lambda stay: (stay[2], stay[:2]))

    def _see_garbage(self, items: list[Item], tick: int) -> None:
        if items == list(self._lying):
            return
        there = dict.fromkeys(items, tick)
        for item in self._lying.keys() - there.keys():
            self._gone.append((item.x, item.y, self._lying[item], tick))
        self._lying = {item: self._lying.get(item, tick) for item in there}
