"""The state of the island in an episode, for Python: actions, observers, the log."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import ceil, inf
from typing import Any, Final

import numpy as np
import pymunk

from islandgp.domains.island import engine
from islandgp.domains.island.chipmunk import address
from islandgp.domains.island.events import EVENTS, Award, IslandEventLog
from islandgp.domains.island.fields import EPISODE, EVENT, ROCK, STATION
from islandgp.domains.island.schedule import Table, draw_schedule
from islandgp.domains.island.space import space_at_start
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import FAR, FULL, MICRO, IslandWorld

_NAMES: Final = EPISODE.names or ()
_AT: Final = {name: at for at, name in enumerate(_NAMES)}
NONE_YET: Final = (
    *("wish_x", "wish_y", "goal_x", "goal_y", "item", "humanoid", "fined_at"),
    *("rewarded_segment", "negative_since"),
)
"""Fields of the record that are -1 at step 0."""
OF_ROBOT: Final = (
    *("capacity", "speed", "radius", "perception", "pickup_reach", "station_reach"),
    "patrol_segment",
)
"""Settings of the robot that are fields of the record as they are."""
_PENDING, _BEST, _NEGATIVE = (_AT[n] for n in ("event_count", "best_step", "negative_since"))


class State:
    """Everything that a tick can read or change.

    The fields of `fields.EPISODE` are its attributes, such as `step`, `x`, `y` and `load`.
    """

    __slots__ = (
        "_events", "_kept", "_numbers", "board", "event_log", "garbage", "people", "physics",
        "record", "schedule", "world",
    )  # fmt: skip

    def __init__(
        self,
        world: IslandWorld,
        seed: int,
        award: Award,
        thresholds: Sequence[float] = (),
        **flags: bool,
    ) -> None:
        """The island at step 0.

        Args:
            world: settings of the island.
            seed: of the world.
            award: component and points by event.
            thresholds: battery levels in percent that the tree compares with.
            flags: `stepwise`, `timed` and `may_coast`.
        """
        self.world, self.schedule = world, draw_schedule(world, seed)
        starts, self.physics = self.schedule.humanoids, space_at_start(world, self.schedule)
        record, kept = _settings(world)
        self.record: Table = record.copy()
        self._numbers = self.record.view(np.int64).data
        self.garbage, self.people = self.schedule.garbage.copy(), starts.copy()
        robot, *humanoids = map(address, self.physics.bodies)
        self.people["body"] = humanoids
        self._events = np.zeros(len(starts) + 16, EVENT)
        board = np.zeros(len(VOCABULARY.keys))
        self.board: Any = board.data
        self.event_log = IslandEventLog(award)
        tables = {
            "items": self.garbage,
            "humanoids": self.people,
            "rocks": np.array(self.schedule.obstacles, np.float64).view(ROCK),
            "marks": _marks(world, thresholds),
            "spawns": self.schedule.spawns,
            "turns": self.schedule.turns,
            "cell_starts": self.schedule.cell_starts,
            "cell_items": self.schedule.cell_items,
            "board": board,
            "events": self._events,
            "contacts": self.physics.contacts.table,
        }
        self._kept = kept, tables  # as long as their addresses are in use
        for name, values in tables.items():
            self._numbers[_AT[f"{name}_at"]] = values.ctypes.data
            if name in _AT:
                self._numbers[_AT[name]] = values.size
        for name, value in {
            "space": address(self.physics.space),
            "body": robot,
            "columns": self.schedule.columns,
            "first_item": self.schedule.initial,
            "room": world.garbage.most - self.schedule.initial,
            **flags,
        }.items():
            self._numbers[_AT[name]] = value

    def __getattr__(self, name: str) -> Any:
        """A field of the record."""
        if name not in _AT:
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return self.record[name].item()

    @property
    def ending(self) -> str:
        """The reason for the end of the episode, one of `SCHEMA.endings`."""
        if self.battery <= 0:
            return "shutdown"
        if self.step >= self.length:
            return "time"
        start = self.negative_since
        return "negative" if 0 <= start <= self.step - self.negative else "stagnation"

    def count_events(self) -> None:
        """Counts the events of compiled functions."""
        numbers = self._numbers
        if not numbers[_PENDING]:
            return
        for step, kind, amount in self._events[: numbers[_PENDING]].tolist():
            self.event_log.log(step, EVENTS[kind], amount)
        numbers[_PENDING] = 0
        numbers[_BEST] = self.event_log.best_step
        numbers[_NEGATIVE] = self.event_log.negative_since

    def log(self, event: str, amount: float) -> None:
        """Records an event of this step."""
        self.event_log.log(self.step, event, amount)
        self._numbers[_BEST] = self.event_log.best_step
        self._numbers[_NEGATIVE] = self.event_log.negative_since

    def perform(self, action: int, shared: bool, fresh: bool) -> int:
        """Calls an action of the robot; returns its status.

        Args:
            action: its number in the vocabulary.
            shared: several leaves of the tree have it.
            fresh: as in `behaviour`.
        """
        if shared and fresh:
            self.record["restarted"] = True
        status: int = engine.act(self.record, action, fresh)
        if self._numbers[_PENDING]:
            self.count_events()
        return status


@lru_cache(maxsize=8)
def _settings(world: IslandWorld) -> tuple[Table, dict[str, Table]]:
    """The record of an episode at step 0 with a world's settings, and the stations."""
    record, stations = np.zeros(1, EPISODE), dict[str, Table]()
    for name, points in (
        ("chargers", world.chargers),
        ("points", world.clearing_points),
        ("waypoints", world.waypoints),
    ):
        stations[name] = table = np.array(points, np.float64).view(STATION)
        record[f"{name}_at"], record[name] = table.ctypes.data, table.size
    episode, robot, people, step = world.episode, world.robot, world.humanoids, world.episode.step

    def steps(seconds: float) -> int:
        return max(1, min(FAR, round(seconds / step)))

    stride, walk = robot.speed * step, people.speed * step
    # The engine pushes a humanoid out of walls and rocks by less than the depth of the overlaps.
    pushed = 2 * max(0.0, walk - pymunk.Space().collision_slop)
    for name, value in {
        "x": world.start[0],
        "y": world.start[1],
        "heading_x": 1.0,
        **dict.fromkeys(NONE_YET, -1),
        "lead": inf,
        "wake": FAR,
        "spent": FULL,
        "battery": round(robot.battery_start * MICRO),
        "drain_moving": min(FULL, round(robot.drain_moving * step * MICRO)),
        "drain_standing": min(FULL, round(robot.drain_standing * step * MICRO)),
        "charge": min(FULL, round(robot.charge_rate * step * MICRO)),
        "charge_below": ceil(robot.charge_below * MICRO),
        "charge_again": ceil(robot.charge_again * MICRO),
        "low_battery": round(episode.low_battery * MICRO),
        "length": steps(episode.length),
        "stagnation": steps(episode.stagnation),
        "stagnation_low_battery": steps(episode.stagnation_low_battery),
        "negative": min(FAR, round(episode.negative / step)),
        "second": steps(1),
        **{name: getattr(robot, name) for name in OF_ROBOT},
        "ask_from": people.ask_from,
        "most_items": people.most_items,
        "dt": step,
        "stride": stride,
        "humanoid_speed": people.speed,
        "humanoid_radius": people.radius,
        "humanoid_stride": walk + pushed,
        "hand_over_reach": people.reach,
        "side": world.side,
        "cell": world.cell,
    }.items():
        record[name] = value
    return record, stations


def _marks(world: IslandWorld, thresholds: Sequence[float]) -> Table:
    """Charges in ascending order of which one side may have another result than the other."""
    levels = (*thresholds, world.episode.low_battery, world.robot.charge_below, 0, 100)
    charges = {round(level * MICRO) for level in levels}
    return np.array(sorted(charge for charge in charges if 0 <= charge <= FULL), np.int64)
