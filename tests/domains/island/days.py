"""Episodes for tests: worlds with a few numbers changed, and what happened at each step."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import STATUS_NAMES, Node
from islandgp.domain.rewards import worth
from islandgp.domains.island import episode
from islandgp.domains.island.events import Award
from islandgp.domains.island.state import State
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import MICRO, IslandWorld
from tests.composed import composed

ISLAND: dict[str, Any] = {
    # The numbers that the tests of this folder were worked out with, independent of conf.
    "side": 300,
    "start": [150, 150],
    "chargers": [[60, 60], [240, 60], [60, 240], [240, 240]],
    "clearing_points": [[60, 150], [240, 150]],
    "waypoints": [
        [150, 40], [215, 85], [260, 150], [215, 215], [150, 260], [85, 215], [40, 150], [85, 85],
    ],
    "robot": {
        "speed": 5, "radius": 0.6, "capacity": 30, "perception": 15, "pickup_reach": 1.5,
        "station_reach": 2, "battery_start": 70, "drain_moving": 0.2, "drain_standing": 0.05,
        "charge_rate": 5, "charge_below": 95, "charge_again": 10, "patrol_segment": 20,
    },
    "garbage": {"initial": 120, "every": 2, "most": 150},
    "humanoids": {
        "count": 10, "speed": 1.2, "radius": 0.4, "turn_every": [4, 10], "most_items": 10,
        "ask_from": 5, "reach": 2,
    },
    "obstacles": {"count": 15, "radius": [2, 4], "gap": 4, "layout_seed": 0},
    "episode": {
        "step": 0.1, "length": 420, "stagnation": 120, "stagnation_low_battery": 180,
        "low_battery": 40, "negative": 60,
    },
}  # fmt: skip


def world(**changes: Any) -> IslandWorld:
    """ISLAND; a mapping changes a part: `world(robot={"speed": 3})`."""
    plain = composed().world.model_dump()
    for name, value in (*ISLAND.items(), *changes.items()):
        plain[name] = {**plain[name], **value} if isinstance(value, dict) else value
    return IslandWorld.model_validate(plain)


def points(stage: int = 0) -> Award:
    """The paper's rewards in a stage (from 0)."""
    settings = composed()
    return worth(settings.rewards, settings.curriculum.multipliers(stage))


@dataclass(frozen=True)
class Episode:
    """What tests compare of an episode that has ended."""

    events: tuple[tuple[int, str, float], ...]  # (step, event, amount), in order
    steps: int
    ending: str
    fitness: float
    points: Mapping[str, float]  # by component, of those that earned some
    battery: float  # % at the end
    distance: float  # m driven
    inactive: float  # s since the last non-movement action
    laps: int
    ticks: int  # how often the tree was ticked; a cost, not a result


def run_episode(
    tree: Node, island: IslandWorld, seed: int, award: Award, **options: Any
) -> Episode:
    """Runs an episode; `options` are those of the island's function."""
    end = episode.run_episode(tree, island, seed, award, **options)
    return Episode(
        events=tuple(end.event_log.events),
        steps=end.step,
        ending=end.ending,
        fitness=end.event_log.fitness,
        points=end.event_log.points,
        battery=max(0, end.battery) / MICRO,
        distance=end.odometer * end.stride,
        inactive=(end.step - end.last_action) * island.episode.step,
        laps=end.laps,
        ticks=end.ticks,
    )


@dataclass(frozen=True)
class Moment:
    """The island after a tick."""

    step: int
    x: float
    y: float
    battery: float  # %
    load: int
    board: tuple[float, ...]
    status: str  # of the root
    lying: int  # items on the ground
    carried: tuple[int, ...]  # by each humanoid
    touching: frozenset[int]  # humanoids, or below 0 static shapes


@dataclass(frozen=True)
class Day:
    """An episode and its moments, one for each step."""

    episode: Episode
    moments: tuple[Moment, ...]

    @property
    def statuses(self) -> list[str]:
        """The root's status at each tick."""
        return [moment.status for moment in self.moments]

    def amounts(self, event: str) -> list[float]:
        """The amounts of all events of a kind, in order."""
        return [amount for _, kind, amount in self.episode.events if kind == event]

    def steps(self, event: str) -> list[int]:
        """When they happened."""
        return [step for step, kind, _ in self.episode.events if kind == event]

    def counts(self) -> dict[str, int]:
        """Events by name; leftover garbage, which every episode has, left out."""
        counter = Counter(event.upper() for _, event, _ in self.episode.events)
        del counter["LEFTOVER"]
        return dict(counter)


def day(tree: str, island: IslandWorld, *, seed: int = 0, stage: int = 0) -> Day:
    """Runs a tree and looks at every step."""
    moments: list[Moment] = []
    root: list[int] = []

    def watch(node: int, status: int) -> None:
        if node == 0:
            root.append(status)

    def observe(now: State) -> None:
        moments.append(
            Moment(
                step=now.step,
                x=now.x,
                y=now.y,
                battery=now.battery / MICRO,
                load=now.load,
                board=tuple(now.board.tolist()),
                status=STATUS_NAMES[root[-1]],
                lying=int(now.garbage["present"].sum()),
                carried=tuple(now.people["carried"].tolist()),
                touching=frozenset(now.physics.contacts.touching),
            )
        )

    ended = run_episode(
        parse(tree, VOCABULARY),
        island,
        seed,
        points(stage),
        stepwise=True,
        watch=watch,
        observe=observe,
    )
    return Day(ended, tuple(moments))
