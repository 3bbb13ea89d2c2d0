"""A robot that carries boxes from a shelf to a dock, with a battery: replace it by yours.

`Robot` is one episode: `sense` returns the keys, each method of an action's name is called once
a tick while the action runs, and `step` advances the time.
"""

import numpy as np
from pydantic import BaseModel, Field

from islandgp.domain import (
    Action,
    Event,
    Scene,
    Schema,
    Shape,
    ShapeStyle,
    SimulatorDomain,
    Vocabulary,
    flag,
    number,
)

SHELF, DOCK = 8.0, 0.0  # m
SPEED = 1.0  # m a tick

SCHEMA = Schema(
    vocabulary=Vocabulary(
        domain="my_robot",
        actions={  # actions with a common resource never run in the same tick
            "DriveToShelf": Action("drives to the shelf", uses=("base",)),
            "DriveToDock": Action("drives to the dock", uses=("base",)),
            "Load": Action("takes a box from the shelf; may fail", uses=("arm",)),
            "Unload": Action("puts the box down at the dock", uses=("arm",)),
            "Charge": Action("charges at the dock until the battery is full", uses=("base",)),
        },
        keys={
            "loaded": flag("the robot carries a box"),
            "at_shelf": flag("the robot is at the shelf"),
            "at_dock": flag("the robot is at the dock"),
            "battery": number("charge of the battery, %", 0, 100, most=100),
        },
    ),
    components={"work": "boxes delivered", "effort": "time, failures and an empty battery"},
    events={
        "loaded": Event("boxes taken"),
        "delivered": Event("boxes delivered"),
        "charged": Event("times the battery was full again"),
        "failed": Event("failed attempts to take a box"),
        "empty": Event("times the battery was empty"),
        "tick": Event("ticks"),
    },
    task="A robot carries boxes from a shelf to a dock, where it can charge its battery.",
    endings={"time": "its ticks were over", "battery empty": "the battery was empty"},
    habits=("Charge before the battery is too low for a round.",),
    styles={
        "robot": ShapeStyle("robot", "R", "triangle", "#1a73e8"),
        "place": ShapeStyle("shelf (S) and dock (D)", "P", "square", "#8d6e63"),
    },
)


class World(BaseModel, frozen=True, extra="forbid"):
    """The settings of a world: `world.NAME=VALUE` changes one."""

    ticks: int = Field(ge=1, le=100_000)  # of an episode, at most
    drain: float = Field(ge=0, le=50)  # % of the battery a metre
    failure: float = Field(ge=0, le=1)  # probability that taking a box fails


class Robot:
    """One episode in the world of one seed."""

    def __init__(self, world, seed, log):
        self.world, self.log, self.rng = world, log, np.random.default_rng(seed)
        self.place, self.loaded = DOCK, False
        self.battery = float(self.rng.uniform(60, 100))

    def sense(self):
        at = {"at_shelf": self.place == SHELF, "at_dock": self.place == DOCK}
        return {"loaded": self.loaded, "battery": self.battery, **at}

    def DriveToShelf(self):
        yield from self._drive(SHELF)
        return True

    def DriveToDock(self):
        yield from self._drive(DOCK)
        return True

    def Load(self):
        yield
        if self.loaded or self.place != SHELF or self.rng.random() < self.world.failure:
            self.log("failed")
            return False
        self.loaded = True
        self.log("loaded")
        return True

    def Unload(self):
        if not self.loaded or self.place != DOCK:
            return False
        self.loaded = False
        self.log("delivered")
        return True

    def Charge(self):
        if self.place != DOCK:
            return False
        if self.battery < 100:
            while self.battery < 100:
                self.battery = min(100.0, self.battery + 10)
                yield
            self.log("charged")
        return True

    def step(self):
        self.log("tick")
        if self.battery > 0:
            return ""
        self.log("empty")
        return "battery empty"

    def scene(self):
        places = (Shape("place", x, 0, 0.6, sign) for x, sign in ((SHELF, "S"), (DOCK, "D")))
        robot = Shape("robot", self.place, 1, 0.4, "box" if self.loaded else "")
        return Scene(bounds=(-1, -2, 9, 3), movers=(*places, robot))

    def _drive(self, goal):
        while self.place != goal:
            self.place += SPEED if goal > self.place else -SPEED
            self.battery = max(0.0, self.battery - self.world.drain * SPEED)
            yield


class MyRobot(SimulatorDomain):
    """The domain: what configuration names as `factory`."""

    World, Episode, schema = World, Robot, SCHEMA
