"""A mobile manipulator that carries blocks from one table to another, and often fails.

It must know where it is to drive, and drive with its arm tucked. Each skill fails now and
then, so that a tree has to look at what was reached, not at what was tried.
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
    integer,
)

TABLES = {"start": (0.0, 0.0), "pick": (-3.0, 2.0), "place": (3.0, 2.0)}  # m

READY = ("Localise", "Tuck")  # what driving needs
BASE, BOTH = ("base",), ("arm", "base")  # what actions use

SCHEMA = Schema(
    vocabulary=Vocabulary(
        domain="pick_place",
        actions={
            "Localise": Action("finds out where the robot is, in two ticks; may fail", uses=BASE),
            "Tuck": Action("tucks the arm", uses=("arm",)),
            "MoveToPick": Action("drives to the blocks; needs to be ready", after=READY, uses=BASE),
            "MoveToPlace": Action(
                "drives to the goal table; needs to be ready", after=READY, uses=BASE
            ),
            "Pick": Action(
                "picks up a block and untucks the arm; may fail", after=("MoveToPick",), uses=BOTH
            ),
            "Place": Action(
                "places the block, untucks the arm; may fail", after=("MoveToPlace",), uses=BOTH
            ),
        },
        keys={
            "localised": flag("the robot knows where it is"),
            "arm_tucked": flag("the arm is tucked"),
            "at_pick": flag("the robot is at the table with blocks"),
            "at_place": flag("the robot is at the goal table"),
            "have_block": flag("the robot holds a block"),
            "blocks_left": integer("blocks that are not yet placed", 0, 3, most=9),
        },
    ),
    components={"progress": "blocks picked and placed", "effort": "time and failures"},
    events={
        "localised": Event("times localised"),
        "moved": Event("arrivals at a table"),
        "picked": Event("blocks picked up"),
        "placed": Event("blocks placed"),
        "failed": Event("failed attempts to pick or place"),
        "tick": Event("ticks"),
    },
    task="A mobile robot with an arm carries blocks from one table to another. Skills may fail.",
    endings={"task done": "all blocks are placed", "time": "its ticks were over"},
    habits=("Check what has been reached before acting.", "Tuck the arm before driving."),
    styles={
        "robot": ShapeStyle("robot", "R", "triangle", "#1a73e8"),
        "table": ShapeStyle("table with its blocks", "T", "square", "#8d6e63"),
    },
)


class World(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    blocks: int = Field(ge=1, le=9)
    ticks: int = Field(ge=1, le=10_000)  # of an episode, at most
    drive: int = Field(ge=1, le=100)  # ticks from table to table
    failure: float = Field(ge=0, le=1)  # probability that a skill fails
    lost: float = Field(ge=0, le=1)  # probability that driving makes `localised` false


class Robot:
    """One episode: a method for each action."""

    def __init__(self, world, seed, log):
        self.world, self.log, self.rng = world, log, np.random.default_rng(seed)
        self.localised = self.arm_tucked = self.have_block = False
        self.at, self.placed = "start", 0

    def sense(self):
        at = {"at_pick": self.at == "pick", "at_place": self.at == "place"}
        own = {key: getattr(self, key) for key in ("localised", "arm_tucked", "have_block")}
        return {**own, **at, "blocks_left": self.world.blocks - self.placed}

    def Localise(self):
        yield
        if not self.localised:  # or a robot could earn points by asking again and again
            self.localised = self._try("localised", self.world.failure)
        return self.localised

    def Tuck(self):
        self.arm_tucked = True
        return True

    def MoveToPick(self):
        return (yield from self._drive("pick"))

    def MoveToPlace(self):
        return (yield from self._drive("place"))

    def Pick(self):
        return self._handle("picked", self.at == "pick" and not self.have_block)

    def Place(self):
        return self._handle("placed", self.at == "place" and self.have_block)

    def step(self):
        self.log("tick")
        return "task done" if self.placed == self.world.blocks else ""

    def scene(self):
        blocks = {"pick": self.world.blocks - self.placed - self.have_block, "place": self.placed}
        tables = (Shape("table", *TABLES[name], 0.8, str(n)) for name, n in blocks.items())
        robot = Shape("robot", *TABLES[self.at], 0.4, "block" if self.have_block else "")
        return Scene(bounds=(-5, -2, 5, 4), movers=(*tables, robot))

    def _try(self, event, chance):
        done = self.rng.random() >= chance
        if done:
            self.log(event)
        return done

    def _drive(self, table):
        if self.at == table or not (self.localised and self.arm_tucked):
            return self.at == table
        for _ in range(self.world.drive):
            yield
        self.at = table
        self.log("moved")
        self.localised = self.rng.random() >= self.world.lost
        return True

    def _handle(self, event, possible):
        self.arm_tucked = False
        done = possible and self._try(event, self.world.failure)
        if done:
            self.have_block = event == "picked"
            self.placed += event == "placed"
        else:
            self.log("failed")
        return done


class PickPlace(SimulatorDomain):
    """The domain."""

    World, Episode, schema = World, Robot, SCHEMA
