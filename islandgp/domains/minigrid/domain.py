"""MiniGrid as a domain: an episode is a level, chosen by the world's seed."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from importlib.util import find_spec
from typing import Any, ClassVar, Final, Self

from pydantic import BaseModel, Field

from islandgp.bt.vocabulary import Action, Condition, Vocabulary, flag, number
from islandgp.domain import Counter, Event, Schema
from islandgp.domains.minigrid.robot import Robot, levels
from islandgp.errors import ConfigError
from islandgp.scoring.rewards import RewardTable
from islandgp.ticking import EventLog, Simulation, Stepped

SCHEMA: Final = Schema(
    vocabulary=Vocabulary(
        domain="minigrid",
        actions={
            "GoToKey": Action(
                "goes to the nearest key that it has seen and faces it; fails without a way",
                to_start=(Condition("keySeen", "is", 0),),
            ),
            "GoToDoor": Action(
                "goes to the nearest closed door that is not locked; fails without a way",
                to_start=(Condition("doorSeen", "is", 0),),
            ),
            "GoToLockedDoor": Action(
                "goes to the nearest locked door that it has seen; fails without a way",
                to_start=(Condition("lockedDoorSeen", "is", 0),),
            ),
            "GoToObject": Action(
                "goes to the object that the mission asks for and faces it; fails without a way",
                to_start=(Condition("objectSeen", "is", 0),),
            ),
            "GoToThing": Action(
                "goes to the nearest ball or box that the mission does not ask for and faces it",
                to_start=(Condition("thingSeen", "is", 0),),
            ),
            "GoToGoal": Action(
                "goes onto the goal; fails unless it has seen it and knows a way",
                to_start=(Condition("goalSeen", "is", 0),),
            ),
            "Explore": Action(
                "goes to the nearest place beside what it has not seen, until it sees something"
                " new; fails where no such place can be reached",
                to_start=(Condition("moreToSee", "is", 0),),
            ),
            "PickUp": Action("picks up what is in front; fails with a full hand or nothing there"),
            "Toggle": Action("opens the closed door in front; a locked one needs its key in hand"),
            "Drop": Action(
                "puts down what it carries beside itself, or behind where that is taken; fails"
                " with an empty hand"
            ),
        },
        keys={
            "carryingKey": flag("a key is in the robot's hand"),
            "keySeen": flag("it has seen a key that lies somewhere"),
            "doorSeen": flag("it has seen a closed door that is not locked"),
            "lockedDoorSeen": flag("it has seen a locked door"),
            "objectSeen": flag("it has seen the object that the mission asks for"),
            "thingSeen": flag("it has seen a ball or box that the mission does not ask for"),
            "goalSeen": flag("it has seen the goal"),
            "moreToSee": flag("a place that it knows is beside one that it has not seen"),
            "facingDoor": flag("a closed door is right in front"),
            "stepsLeft": number(
                "steps that are left, in percent of the level's", 0, 100, 5, most=100
            ),
        },
    ),
    components={
        "solved": "the mission, and how quickly",
        "progress": "keys picked up, doors opened, places seen",
        "effort": "steps",
    },
    events={
        "solved": Event("missions done", "the environment's own reward, 0 to 1"),
        "key": Event("keys picked up for the first time"),
        "opened": Event("doors opened for the first time"),
        "unlocked": Event("locked doors opened for the first time"),
        "dropped": Event("things put down"),
        "seen": Event("times that something new was seen", "places"),
        "step": Event("steps"),
    },
    counters={
        "solved": Counter("missions done"),
        "reward": Counter("the environment's own reward, 0 to 1"),
        "key": Counter("keys picked up for the first time", heading="keys"),
        "opened": Counter("doors opened for the first time"),
        "unlocked": Counter("locked doors opened for the first time"),
        "dropped": Counter("things put down"),
        "explored": Counter("places of the level that it has seen", "%"),
        "step": Counter("steps", heading="steps"),
    },
    task="A robot in a maze of rooms does what the level's mission says: reach the goal, open the"
    " door, or pick up an object. Doors may be closed or locked; a locked one needs its key. The"
    " robot sees what is before it, not through walls and closed doors, and remembers it. It"
    " carries one thing at a time.",
    habits=(
        "Do the mission as soon as its goal or object has been seen and can be reached.",
        "Explore where nothing better is to do; open doors when the rooms are known.",
        "A key is for a locked door; a full hand picks nothing up.",
    ),
)


class Levels(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    levels: tuple[str, ...] = Field(min_length=1)
    """Names as MiniGrid has them, without `MiniGrid-` and the version; a seed plays one of them."""
    ticks: int = Field(ge=1, le=10_000)  # steps of an episode, at most; a level may have fewer


class MiniGrid(Stepped):
    """The domain."""

    World: ClassVar[type[BaseModel]] = Levels
    Episode: ClassVar[Callable[[Any, int, EventLog], Simulation]] = Robot
    schema: Schema = SCHEMA

    @classmethod
    def make(cls, world: Levels, rewards: RewardTable) -> Self:
        """See `Domain`. Raises ConfigError without MiniGrid, or for a level that it has not."""
        if find_spec("minigrid") is None:
            raise ConfigError(
                "domain=minigrid: expected the package minigrid, found none; install it with"
                " pip install 'islandgp[minigrid]'."
            )
        known = list(levels())
        for level in world.levels:
            if level not in known:
                near = get_close_matches(level, known, 1, 0.4)
                hint = f"did you mean {near[0]}?" if near else f"there is, e.g., {known[0]}"
                raise ConfigError(
                    f"world.levels: expected levels of MiniGrid that stand still, found {level!r};"
                    f" {hint}"
                )
        return cls(world, rewards)
