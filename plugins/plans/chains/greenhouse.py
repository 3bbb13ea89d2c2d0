"""A greenhouse robot that waters the dry house: it must fetch the can, fill it, and open the door.

A watering is a chain: drive to the shed, fetch the can, drive to the tap, fill it, drive to the
door of the dry house, open it, go in, water, go out. The robot of the final test: nothing was
tuned on it.
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

HOUSES = ("north", "south", "west")
PLACES = ("shed", "tap", *HOUSES)
TOOLS = ("none", "can", "shears")

SCHEMA = Schema(
    vocabulary=Vocabulary(
        domain="greenhouse",
        actions={
            "Drive": Action("drives outdoors", arguments={"to": one_of("where to", PLACES)}),
            "Fetch": Action(
                "takes a tool in the shed, and puts the other one back",
                arguments={"tool": one_of("which", TOOLS[1:])},
            ),
            "Fill": Action("fills the can at the tap"),
            "OpenDoor": Action("opens the door of the house"),
            "GoIn": Action("goes into the house"),
            "GoOut": Action("goes out of the house"),
            "Water": Action("waters the house with a full can"),
            "Cut": Action("cuts the plants of the house with shears"),
            "Rest": Action("rests in the sun, which charges the battery"),
        },
        keys={
            "place": enumeration("where the robot is", PLACES),
            "dry": enumeration("the house that is dry", PLACES),
            "tool": enumeration("the tool that it holds", TOOLS),
            "full": flag("the can is full"),
            "inside": flag("the robot is in a house"),
            "door_open": flag("the door of the house where the robot is is open"),
            "battery": number("charge of the battery, %", 0, 100, 5, most=100),
        },
    ),
    components={"service": "houses watered", "effort": "failures and a flat battery"},
    events={
        "watered": Event("dry houses watered"),
        "cut": Event("plants cut"),
        "failed": Event("actions that failed"),
        "flat": Event("the battery was empty"),
    },
    task="A robot waters the house that is dry.",
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
        self.place, self.tool = PLACES[self.rng.integers(5)], TOOLS[self.rng.integers(3)]
        self.full = self.inside = self.door_open = False
        self.battery = float(self.rng.uniform(50, 100))
        self._dries()

    def _dries(self):
        self.dry = HOUSES[self.rng.integers(3)]

    def sense(self):
        return {key: getattr(self, key) for key in SCHEMA.vocabulary.keys}

    def Drive(self, to):
        if self.inside:
            return self._failed()
        if self.place != to:
            yield from self._works(3)
            self.place, self.door_open = to, False
        return True

    def Fetch(self, tool):
        if self.place != "shed":
            return self._failed()
        if self.tool != tool:
            yield from self._works(1)
            self.tool, self.full = tool, False
        return True

    def Fill(self):
        if self.place != "tap" or self.tool != "can":
            return self._failed()
        if not self.full:
            yield from self._works(2)
            self.full = True
        return True

    def OpenDoor(self):
        if self.place not in HOUSES:
            return self._failed()
        if not self.door_open:
            yield from self._works(1)
            self.door_open = True
        return True

    def GoIn(self):
        if not self.door_open or self.inside:
            return self._failed()
        yield from self._works(1)
        self.inside = True
        return True

    def GoOut(self):
        if not self.inside:
            return self._failed()
        yield from self._works(1)
        self.inside = False
        return True

    def Water(self):
        if not (self.inside and self.full and self.place == self.dry):
            return self._failed()
        yield from self._works(2)
        self.full = False
        self.log("watered")
        self._dries()
        return True

    def Cut(self):
        if not (self.inside and self.tool == "shears"):
            return self._failed()
        yield from self._works(2)
        self.log("cut")
        return True

    def Rest(self):
        if self.inside:
            return self._failed()
        while self.battery < 95:
            yield
            self.battery = min(100.0, self.battery + 5)
        return True

    def step(self):
        if self.battery <= 0:
            self.log("flat")
            return "flat"
        return ""

    def _works(self, ticks):
        for _ in range(ticks):
            self.battery = max(0.0, self.battery - self.world.drain)
            yield

    def _failed(self):
        self.log("failed")
        return False


class Greenhouse(SimulatorDomain):
    """The domain."""

    World, Episode, schema = World, Robot, SCHEMA
