"""The island as a domain: its episodes, and their data for observers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from islandgp.domain import (
    Condition,
    Domain,
    Node,
    Observer,
    Outcome,
    RewardTable,
    Scene,
    Shape,
    Vocabulary,
    wants_scenes,
)
from islandgp.domain.rewards import worth
from islandgp.domains.island import world as settings
from islandgp.domains.island.events import EVENTS
from islandgp.domains.island.schedule import obstacles
from islandgp.domains.island.vocabulary import SCHEMA, VOCABULARY

if TYPE_CHECKING:
    from islandgp.domains.island.state import State

EARNED_BY: Final[Mapping[str, str]] = {
    "pickup": "PickupGarbage",
    "interaction": "MoveToHumanoid",
    "charge": "ExecuteCharge",
    "delivery": "DeliverToClearingPoint",
    "empty_delivery": "DeliverToClearingPoint",
    "patrol": "PatrolWaypoint",
    "discovery": "PatrolWaypoint",
}
"""The action to which an event's points are credited; other events have no action."""

GOAL_SIZE: Final = 1.5  # m, in pictures


class Island(Domain):
    """The island of section 2.2.2, in pymunk; its episodes skip ticks that change nothing."""

    World, Rewards, schema = settings.IslandWorld, RewardTable, SCHEMA

    def __init__(self, world: settings.IslandWorld, rewards: RewardTable) -> None:
        """Raises ConfigError if obstacles do not fit."""
        super().__init__(world, rewards)
        obstacles(world)
        self.step_s = world.episode.step

    def vocabulary_in(self, worlds: Sequence[settings.IslandWorld]) -> Vocabulary:
        """See `Domain`: the greatest `capacity` and `charge_below` of the worlds are bounds."""
        keys, actions = dict(VOCABULARY.keys), dict(VOCABULARY.actions)
        room, charge = "robotCurrentExtraCapacity", "ExecuteCharge"
        keys[room] = replace(keys[room], most=max(world.robot.capacity for world in worlds))
        below = Condition("batteryLevel", "<", max(world.robot.charge_below for world in worlds))
        actions[charge] = replace(actions[charge], to_start=(below,))
        return replace(VOCABULARY, keys=keys, actions=actions)

    def about(self, seed: int | None = None) -> str:  # noqa: ARG002 -- all seeds are alike in this
        """See `Domain`."""
        episode = self.world.episode
        return (
            f"An episode has at most {episode.length:g} s, in ticks of {episode.step:g} s. It ends"
            f" early after {episode.stagnation:g} s without a better fitness"
            f" ({episode.stagnation_low_battery:g} s while the battery is low), after"
            f" {episode.negative:g} s of negative fitness, and when the battery is empty."
        )

    def prepare(self) -> None:
        """See `Domain`. Compiles the engine, or loads its machine code."""
        from islandgp.domains.island.episode import compile_engine  # numba takes half a second

        compile_engine(self.world)

    def run_episode(
        self, tree: Node, seed: int, weights: Mapping[str, float], observer: Observer | None = None
    ) -> Outcome:
        """See `Domain`. With an observer the tree is ticked in every step."""
        from islandgp.domains.island.episode import run_episode  # numba takes half a second

        value = worth(self.rewards, weights)
        keys = self.schema.vocabulary.keys
        sensors = None if self.faults is None else self.faults.sensors(keys, seed)
        fixed = self._fixed() if observer is not None and wants_scenes(observer) else None

        def award(event: str, amount: float) -> tuple[str, float]:
            component, points = value(event, amount)
            if component and observer is not None:
                observer.credit(component, points, event, EARNED_BY.get(event, ""))
            return component, points

        def observe(island: State) -> None:
            assert observer is not None
            board = island.board.tolist() if sensors is None else sensors.values
            observer.tick(board, None if fixed is None else self._scene(island, fixed))

        island = run_episode(
            tree,
            self.world,
            seed,
            value if observer is None else award,
            stepwise=observer is not None,
            watch=None if observer is None else observer.node,
            observe=None if observer is None else observe,
            sensors=sensors,
        )
        log = island.event_log
        counts, amounts = dict.fromkeys(EVENTS, 0.0), dict.fromkeys(EVENTS, 0.0)
        for _, event, amount in log.events:
            counts[event] += 1
            amounts[event] += amount
        return Outcome(
            components={**dict.fromkeys(self.schema.components, 0.0), **log.points},
            counters={
                "pickups": counts["pickup"],
                "interactions": counts["interaction"],
                "deliveries": counts["delivery"],
                "charges": counts["charge"],
                "gathered": amounts["pickup"] + amounts["interaction"],
                "delivered": amounts["delivery"],
                "collisions": counts["collision"],
                "distance": island.odometer * island.stride,
                "inactive": (island.step - island.last_action) * self.step_s,
                "laps": float(island.laps),
                "battery": max(0, island.battery) / settings.MICRO,
            },
            seconds=island.step * self.step_s,
            endings=(island.ending,),
        )

    def _fixed(self) -> tuple[Shape, ...]:
        """The shapes that do not move, for all pictures of an episode."""
        world = self.world
        stations = (
            ("waypoint", world.waypoints),
            ("charger", world.chargers),
            ("clearing", world.clearing_points),
        )
        return (
            *(Shape("rock", x, y, radius) for x, y, radius in obstacles(world)),
            *(
                Shape(style, x, y, world.robot.station_reach)
                for style, points in stations
                for x, y in points
            ),
        )

    def _scene(self, island: State, fixed: tuple[Shape, ...]) -> Scene:
        world, reach = self.world, self.world.robot.pickup_reach / 2
        lying = island.garbage[island.garbage["present"] > 0]
        items = tuple(Shape("garbage", x, y, reach) for x, y in lying[["x", "y"]].tolist())
        if island.driving:
            items = (*items, Shape("goal", island.wish_x, island.wish_y, GOAL_SIZE))
        return Scene(
            bounds=(0.0, 0.0, world.side, world.side),
            fixed=fixed,
            items=items,
            movers=(
                Shape("sight", island.x, island.y, world.robot.perception),
                *(
                    Shape(
                        "asking" if carried >= world.humanoids.ask_from else "humanoid",
                        x,
                        y,
                        world.humanoids.radius,
                        str(carried),
                    )
                    for carried, x, y in island.people[["carried", "x", "y"]].tolist()
                ),
                Shape("robot", island.x, island.y, world.robot.radius, str(island.load)),
            ),
        )
