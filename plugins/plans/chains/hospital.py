"""A hospital robot that brings medicine from the pharmacy to a ward on another floor, by a lift.

A delivery is a chain of eight actions with arguments: drive to the pharmacy, take, drive to the
lobby, call the lift, enter, ride to the ordered floor, leave, drive to the ward, hand over.
"""

import numpy as np
from pydantic import BaseModel, Field

from islandgp.domain import (
    Action,
    Event,
    Schema,
    SimulatorDomain,
    Vocabulary,
    enumeration,
    flag,
    number,
    one_of,
)

FLOORS = ("ground", "first", "second")
PLACES = ("lobby", "pharmacy", "dock", "ward")
ON = {"ground": ("lobby", "pharmacy", "dock"), "first": ("lobby", "ward")}

SCHEMA = Schema(
    vocabulary=Vocabulary(
        domain="hospital",
        actions={
            "Drive": Action(
                "drives to a place on this floor", arguments={"to": one_of("where to", PLACES)}
            ),
            "CallLift": Action("calls the lift"),
            "Enter": Action("drives into the lift"),
            "Ride": Action("rides the lift", arguments={"to": one_of("where to", FLOORS)}),
            "Leave": Action("drives out of the lift"),
            "Take": Action("takes the ordered medicine"),
            "HandOver": Action("hands the medicine over"),
            "Charge": Action("charges the battery"),
        },
        keys={
            "place": enumeration("where the robot is; in the lift, the lobby", PLACES),
            "floor": enumeration("the robot's floor", FLOORS),
            "lift_floor": enumeration("the lift's floor", FLOORS),
            "ordered_by": enumeration("the floor of the ward that waits", FLOORS),
            "in_lift": flag("the robot is in the lift"),
            "carrying": flag("the robot carries medicine"),
            "battery": number("charge of the battery, %", 0, 100, 5, most=100),
        },
    ),
    components={"service": "medicine handed over", "effort": "failures and a flat battery"},
    events={
        "taken": Event("medicine taken"),
        "delivered": Event("medicine handed over on the floor that ordered it"),
        "failed": Event("actions that failed"),
        "flat": Event("the battery was empty"),
    },
    task="A robot takes medicine to the ward that ordered it.",
    endings={"flat": "the battery was empty", "time": "its ticks were over"},
)


class World(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    ticks: int = Field(ge=1, le=10_000)  # of an episode, at most
    drain: float = Field(ge=0, le=10)  # % of the battery by tick of an action that moves


class Robot:
    """One episode: a method for each action."""

    def __init__(self, world, seed, log):
        self.world, self.log, self.rng = world, log, np.random.default_rng(seed)
        self.place, self.floor = "lobby", "ground"
        self.lift_floor = FLOORS[self.rng.integers(3)]
        self.in_lift = self.carrying = False
        self.battery = float(self.rng.uniform(50, 100))
        self._order()

    def _order(self):
        self.ordered_by = FLOORS[1 + self.rng.integers(2)]

    def sense(self):
        return {key: getattr(self, key) for key in SCHEMA.vocabulary.keys}

    def Drive(self, to):
        if self.in_lift or to not in ON.get(self.floor, ON["first"]):
            return self._failed()
        if self.place != to:
            yield from self._moves(3)
            self.place = to
        return True

    def CallLift(self):
        if self.in_lift or self.place != "lobby":
            return self._failed()
        while self.lift_floor != self.floor:
            yield
            step = np.sign(FLOORS.index(self.floor) - FLOORS.index(self.lift_floor))
            self.lift_floor = FLOORS[FLOORS.index(self.lift_floor) + step]
        return True

    def Enter(self):
        if self.in_lift or self.place != "lobby" or self.lift_floor != self.floor:
            return self._failed()
        yield from self._moves(1)
        self.in_lift = True
        return True

    def Ride(self, to):
        if not self.in_lift:
            return self._failed()
        if self.floor != to:
            yield from self._moves(2)
            self.floor = self.lift_floor = to
        return True

    def Leave(self):
        if not self.in_lift:
            return self._failed()
        yield from self._moves(1)
        self.in_lift = False
        if self.rng.random() < 0.7:  # somebody else calls it
            self.lift_floor = FLOORS[self.rng.integers(3)]
        return True

    def Take(self):
        if self.in_lift or self.place != "pharmacy" or self.carrying:
            return self._failed()
        yield
        self.carrying = True
        self.log("taken")
        return True

    def HandOver(self):
        right = self.place == "ward" and self.floor == self.ordered_by
        if not (right and self.carrying):
            return self._failed()
        yield
        self.carrying = False
        self.log("delivered")
        self._order()
        return True

    def Charge(self):
        if self.in_lift or self.place != "dock":
            return self._failed()
        while self.battery < 95:
            yield
            self.battery = min(100.0, self.battery + 10)
        return True

    def step(self):
        if self.battery <= 0:
            self.log("flat")
            return "flat"
        return ""

    def _moves(self, ticks):
        for _ in range(ticks):
            self.battery = max(0.0, self.battery - self.world.drain)
            yield

    def _failed(self):
        self.log("failed")
        return False


class Hospital(SimulatorDomain):
    """The domain."""

    World, Episode, schema = World, Robot, SCHEMA
