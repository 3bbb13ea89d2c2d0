"""A forklift that unloads pallets from trucks into a rack: no arguments, a fork at two heights.

The fork must be low to pick a pallet up and to drive, and high to store it. Trucks come and go.
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
)

PLACES = ("bay", "rack", "charger")

SCHEMA = Schema(
    vocabulary=Vocabulary(
        domain="forklift",
        actions={
            "ToBay": Action("drives to the bay with the fork low"),
            "ToRack": Action("drives to the rack with the fork low"),
            "ToCharger": Action("drives to the charger with the fork low"),
            "RaiseFork": Action("raises the fork"),
            "LowerFork": Action("lowers the fork"),
            "PickUp": Action("picks a pallet up at the bay, with the fork low"),
            "Store": Action("stores the pallet in the rack, with the fork high"),
            "Charge": Action("charges the battery at the charger"),
        },
        keys={
            "at": enumeration("where the forklift is", PLACES),
            "fork_high": flag("the fork is high"),
            "loaded": flag("there is a pallet on the fork"),
            "truck": flag("a truck with pallets is at the bay"),
            "battery": number("charge of the battery, %", 0, 100, 5, most=100),
        },
    ),
    components={"service": "pallets stored", "effort": "failures, time and a flat battery"},
    events={
        "picked": Event("pallets picked up"),
        "stored": Event("pallets stored"),
        "failed": Event("actions that failed"),
        "flat": Event("the battery was empty"),
        "tick": Event("ticks"),
    },
    task="A forklift unloads pallets from trucks and stores them in a rack.",
    endings={"flat": "the battery was empty", "time": "its ticks were over"},
)


class World(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    ticks: int = Field(ge=1, le=10_000)  # of an episode, at most
    drain: float = Field(ge=0, le=10)  # % of the battery by tick of an action that moves
    failure: float = Field(ge=0, le=1)  # probability that picking up fails


class Robot:
    """One episode: a method for each action."""

    def __init__(self, world, seed, log):
        self.world, self.log, self.rng = world, log, np.random.default_rng(seed)
        self.at, self.battery = "charger", float(self.rng.uniform(40, 100))
        self.fork_high = bool(self.rng.random() < 0.5)
        self.loaded, self.truck = False, True

    def sense(self):
        return {key: getattr(self, key) for key in SCHEMA.vocabulary.keys}

    def ToBay(self):
        return (yield from self._drive("bay"))

    def ToRack(self):
        return (yield from self._drive("rack"))

    def ToCharger(self):
        return (yield from self._drive("charger"))

    def RaiseFork(self):
        yield from self._work(1)
        self.fork_high = True
        return True

    def LowerFork(self):
        yield from self._work(1)
        self.fork_high = False
        return True

    def PickUp(self):
        if self.at != "bay" or not self.truck or self.fork_high or self.loaded:
            return self._failed()
        yield from self._work(1)
        if self.rng.random() < self.world.failure:
            return self._failed()
        self.loaded = True
        self.log("picked")
        return True

    def Store(self):
        if self.at != "rack" or not self.fork_high or not self.loaded:
            return self._failed()
        yield from self._work(1)
        self.loaded = False
        self.log("stored")
        return True

    def Charge(self):
        if self.at != "charger":
            return self._failed()
        while self.battery < 95:
            yield
            self.battery = min(100.0, self.battery + 10)
        return True

    def step(self):
        self.log("tick")
        self.truck = bool(self.rng.random() < (0.99 if self.truck else 0.1))
        if self.battery <= 0:
            self.log("flat")
            return "flat"
        return ""

    def _drive(self, place):
        if self.fork_high:
            return self._failed()
        if self.at != place:
            yield from self._work(4)
            self.at = place
        return True

    def _work(self, ticks):
        for _ in range(ticks):
            self.battery = max(0.0, self.battery - self.world.drain)
            yield

    def _failed(self):
        self.log("failed")
        return False


class Forklift(SimulatorDomain):
    """The domain."""

    World, Episode, schema = World, Robot, SCHEMA
