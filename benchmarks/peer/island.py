"""The island as a straightforward program keeps it: everything up to date in each step."""

from __future__ import annotations

from math import hypot

import numpy as np
from pymunk import Vec2d

from islandgp.domains.island.events import Award, IslandEventLog
from islandgp.domains.island.fields import ROCK
from islandgp.domains.island.motion import next_leg
from islandgp.domains.island.schedule import draw_schedule
from islandgp.domains.island.space import space_at_start
from islandgp.domains.island.world import ROCK_MARGIN, IslandWorld, Point


class Item:
    """A piece of garbage."""

    def __init__(self, x: float, y: float) -> None:
        self.x, self.y = x, y  # m
        self.seen = False
        self.there = True


class Island:
    """One episode's state."""

    def __init__(self, world: IslandWorld, seed: int, award: Award) -> None:
        self.world = world
        self.schedule = draw_schedule(world, seed)
        self.physics = space_at_start(world, self.schedule)
        self.robot, *self.people = self.physics.bodies
        self.event_log = IslandEventLog(award)
        self.garbage = [
            Item(x, y)
            for x, y in self.schedule.garbage[["x", "y"]][: self.schedule.initial].tolist()
        ]
        self._lay_out()
        self.carried = np.zeros(len(self.people), dtype=int)  # items of each humanoid
        self.met = np.zeros(len(self.people), dtype=bool)  # humanoids seen before
        self.rocks = np.array(self.schedule.obstacles).view(ROCK).ravel()
        self.step = self.spawn = self.turn = 0
        self.dt = world.episode.step
        self.stride = world.robot.speed * self.dt  # m a step
        self.at = self.robot.position
        self.found_garbage = self.asked = False
        self.battery = world.robot.battery_start  # %
        self.load = self.laps = self.waypoint = 0
        self.spent = 100.0  # % used since the last charging attempt that counted
        self.fined_at = -1  # clearing point where an empty delivery has cost in this visit
        self.goal: tuple[float, float, float] | None = None  # x, y, reach: of this tick
        self.leg: tuple[float, float, float] | None = None  # the goal of the present leg
        self.leg_end = 0.0  # step
        self.patrolling = self.acted = self.charging = False  # in this tick
        self.idle = self.patrol_steps = 0
        self.rewarded = -1  # last stretch of patrol with a discovery

    def log(self, event: str, amount: float) -> None:
        """Writes an event down."""
        self.event_log.log(self.step, event, amount)

    def act(self, event: str, amount: float) -> None:
        """A non-movement action."""
        self.log(event, amount)
        self.acted = True

    def drive_to(self, x: float, y: float, reach: float) -> bool:
        """Wants to be within `reach` metres of (x, y); true on arrival."""
        if hypot(x - self.at.x, y - self.at.y) <= reach:
            return True
        self.goal = (x, y, reach)
        return False

    def nearest(self, stations: tuple[Point, ...]) -> int:
        """The nearest station."""
        gaps = [hypot(x - self.at.x, y - self.at.y) for x, y in stations]
        return gaps.index(min(gaps))

    def nearest_item(self, within: float) -> Item | None:
        """The nearest garbage, if it is not further than `within` metres."""
        if not self.garbage:
            return None
        i = int(self.gaps.argmin())
        return self.garbage[i] if self.gaps[i] <= within else None

    def take(self, item: Item) -> None:
        """The item is gone."""
        item.there = False
        self.garbage.remove(item)
        self._lay_out()

    def sense(self) -> None:
        """Looks at everything."""
        sight = self.world.robot.perception
        self.at = self.robot.position
        self.gaps = np.hypot(self.xs - self.at.x, self.ys - self.at.y)
        in_sight = self.gaps <= sight
        self.found_garbage = bool(in_sight.any())
        new = in_sight & ~self.seen
        if new.any():
            for i in np.flatnonzero(new):
                self.garbage[i].seen = True
            self.seen |= new
            self._discover(int(new.sum()))
        self.places = np.array([body.position for body in self.people]).reshape(-1, 2)
        self.apart = np.hypot(self.places[:, 0] - self.at.x, self.places[:, 1] - self.at.y)
        near = self.apart <= sight
        self.asking = self.carried >= self.world.humanoids.ask_from
        self.asked = bool((near & self.asking).any())
        strangers = near & ~self.met
        if strangers.any():
            self.met |= strangers
            self._discover(int(strangers.sum()))
        if self.fined_at >= 0:
            x, y = self.world.clearing_points[self.fined_at]
            if hypot(x - self.at.x, y - self.at.y) > self.world.robot.station_reach:
                self.fined_at = -1

    def turn_wheels(self) -> None:
        """Sets the robot's velocity: to the goal, or along the next leg around a rock."""
        if self.goal is None:
            self.leg = None
            self.robot.velocity = (0.0, 0.0)
        elif self.goal != self.leg or self.step >= self.leg_end:
            x, y, reach = self.leg = self.goal
            margin = self.world.robot.radius, ROCK_MARGIN
            ux, uy, length = next_leg(self.at.x, self.at.y, x, y, reach, self.rocks, margin)
            self.robot.velocity = Vec2d(ux, uy) * self.world.robot.speed
            self.leg_end = self.step + max(1, length / self.stride)

    def pass_time(self) -> None:
        """One step: physics, contacts, cues, battery, idleness."""
        self.physics.space.step(self.dt)
        self.step += 1
        contacts = self.physics.contacts
        for _ in range(contacts.table[1]):
            self.log("collision", 1)
        contacts.table[1] = 0
        for h in sorted(contacts.touching):
            self.leg = None
            if h >= 0:
                away = self.people[h].position - self.robot.position
                self.people[h].velocity = away.normalized() * self.world.humanoids.speed
        self._play_script()
        self._account()

    def _play_script(self) -> None:
        while self.schedule.spawns[self.spawn] == self.step:
            item = self.schedule.garbage[self.schedule.initial + self.spawn]
            x, y = float(item["x"]), float(item["y"])
            self.spawn += 1
            if len(self.garbage) < self.world.garbage.most:
                self.garbage.append(Item(x, y))
                self._lay_out()
        while self.schedule.turns[self.turn]["step"] == self.step:
            _, humanoid, vx, vy = self.schedule.turns[self.turn].tolist()
            self.turn += 1
            self.people[humanoid].velocity = (vx, vy)
            self.carried[humanoid] = min(
                self.carried[humanoid] + 1, self.world.humanoids.most_items
            )

    def _account(self) -> None:
        robot = self.world.robot
        if self.charging and self.goal is None:
            self.battery = min(100.0, self.battery + robot.charge_rate * self.dt)
        else:
            drain = robot.drain_standing if self.goal is None else robot.drain_moving
            self.battery -= drain * self.dt
            self.spent += drain * self.dt
        self.patrol_steps += self.patrolling
        if self.goal is not None or self.acted:
            self.idle = 0
            return
        self.idle += 1
        second = round(1 / self.dt)
        if self.idle % second == 0:
            self.log("idle", self.idle / second)

    def _discover(self, things: int) -> None:
        if not self.patrolling:
            return
        self.log("discovery", things)
        stretch = int(self.patrol_steps * self.stride / self.world.robot.patrol_segment)
        if stretch > self.rewarded:
            self.rewarded = stretch
            self.log("patrol", 1)

    def _lay_out(self) -> None:
        """The garbage as arrays, rebuilt whenever an item comes or goes."""
        self.xs = np.array([item.x for item in self.garbage])
        self.ys = np.array([item.y for item in self.garbage])
        self.seen = np.array([item.seen for item in self.garbage], dtype=bool)
        self.gaps = np.full(len(self.garbage), np.inf)
