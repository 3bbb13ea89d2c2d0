"""The seven actions as py_trees behaviours: `initialise` at the start, `update` in each tick."""

from __future__ import annotations

from typing import Any, Final

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from pymunk import Vec2d

from benchmarks.peer.island import Island, Item
from islandgp.domains.island.behaviour import AIM_EVERY


class Action(Behaviour):
    """A leaf; `setup` hands it the island, as py_trees hands shared things to behaviours."""

    island: Island

    def setup(self, **kwargs: Any) -> None:
        """See `Behaviour`."""
        self.island = kwargs["island"]


class MoveToGarbage(Action):
    """Drives to the nearest garbage in sight."""

    target: Item | None

    def initialise(self) -> None:
        """Chooses the item."""
        self.target = self.island.nearest_item(self.island.world.robot.perception)

    def update(self) -> Status:
        """RUNNING on the way, SUCCESS within reach."""
        item, robot = self.target, self.island.world.robot
        if item is None or not item.there:
            return Status.FAILURE
        arrived = self.island.drive_to(item.x, item.y, robot.pickup_reach)
        return Status.SUCCESS if arrived else Status.RUNNING


class PickupGarbage(Action):
    """Picks up the nearest item, at once."""

    def update(self) -> Status:
        """SUCCESS when an item was in reach and there was room."""
        island = self.island
        item = island.nearest_item(island.world.robot.pickup_reach)
        if item is None or island.load >= island.world.robot.capacity:
            return Status.FAILURE
        island.take(item)
        island.load += 1
        island.act("pickup", 1)
        return Status.SUCCESS


class SeekCharger(Action):
    """Drives to the nearest charger."""

    def initialise(self) -> None:
        """Chooses the charger."""
        chargers = self.island.world.chargers
        self.target = chargers[self.island.nearest(chargers)]

    def update(self) -> Status:
        """RUNNING on the way, SUCCESS on arrival."""
        arrived = self.island.drive_to(*self.target, self.island.world.robot.station_reach)
        return Status.SUCCESS if arrived else Status.RUNNING


class ExecuteCharge(Action):
    """Charges until full."""

    fresh = True

    def initialise(self) -> None:
        """An attempt begins."""
        self.fresh = True

    def update(self) -> Status:
        """RUNNING while charging, SUCCESS when full, FAILURE away from a charger."""
        island, robot = self.island, self.island.world.robot
        fresh, self.fresh = self.fresh, False
        x, y = island.world.chargers[island.nearest(island.world.chargers)]
        away = (island.at - (x, y)).length > robot.station_reach
        if away or (fresh and island.battery >= robot.charge_below):
            return Status.FAILURE
        if island.battery >= 100:
            return Status.SUCCESS
        if island.spent >= robot.charge_again:
            island.spent = 0.0
            island.act("charge", island.battery)
        island.acted = island.charging = True
        return Status.RUNNING


class MoveToHumanoid(Action):
    """Drives to the nearest humanoid that asks, and takes over its garbage."""

    target: int | None
    aim: Vec2d  # where it was last seen

    def initialise(self) -> None:
        """Chooses the humanoid."""
        island = self.island
        asking = [h for h in range(len(island.people)) if island.asking[h]]
        self.target = min(asking, key=lambda h: float(island.apart[h]), default=None)
        self.aim_end = 0

    def update(self) -> Status:
        """RUNNING on the way, SUCCESS when garbage was handed over."""
        island, h = self.island, self.target
        room = island.world.robot.capacity - island.load
        if h is None or room <= 0 or island.carried[h] < island.world.humanoids.ask_from:
            return Status.FAILURE
        gap = island.apart[h]
        if gap > island.world.robot.perception:
            return Status.FAILURE
        if gap <= island.world.humanoids.reach:
            amount = min(int(island.carried[h]), room)
            island.carried[h] -= amount
            island.load += amount
            island.act("interaction", amount)
            return Status.SUCCESS
        if island.step >= self.aim_end or (island.at - self.aim).length < island.stride:
            self.aim = island.people[h].position
            self.aim_end = island.step + AIM_EVERY
        island.goal = (self.aim.x, self.aim.y, 0.0)
        return Status.RUNNING


class DeliverToClearingPoint(Action):
    """Drives to the nearest clearing point and unloads."""

    def initialise(self) -> None:
        """Chooses the clearing point."""
        self.point = self.island.nearest(self.island.world.clearing_points)

    def update(self) -> Status:
        """RUNNING on the way, SUCCESS when something was unloaded."""
        island = self.island
        x, y = island.world.clearing_points[self.point]
        if not island.drive_to(x, y, island.world.robot.station_reach):
            return Status.RUNNING
        if island.load > 0:
            island.act("delivery", island.load)
            island.load = 0
            return Status.SUCCESS
        if island.fined_at != self.point:
            island.fined_at = self.point
            island.act("empty_delivery", 1)
        return Status.FAILURE


class PatrolWaypoint(Action):
    """Drives to the next waypoint."""

    def update(self) -> Status:
        """RUNNING on the way, SUCCESS on arrival."""
        island, waypoints = self.island, self.island.world.waypoints
        if island.drive_to(*waypoints[island.waypoint], island.world.robot.station_reach):
            island.waypoint = (island.waypoint + 1) % len(waypoints)
            island.laps += island.waypoint == 0
            return Status.SUCCESS
        island.patrolling = True
        return Status.RUNNING


ACTIONS: Final[dict[str, type[Action]]] = {
    action.__name__: action
    for action in (
        MoveToGarbage,
        PickupGarbage,
        SeekCharger,
        ExecuteCharge,
        MoveToHumanoid,
        DeliverToClearingPoint,
        PatrolWaypoint,
    )
}
