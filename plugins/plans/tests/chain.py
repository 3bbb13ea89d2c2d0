"""A robot with a chain of actions: it fetches the right key, and opens the door with it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import BaseModel

from islandgp.domain import (
    Action,
    Event,
    EventLog,
    Reward,
    RewardTable,
    Schema,
    SimulatorDomain,
    Vocabulary,
    enumeration,
    flag,
    one_of,
)

COLOURS = ("red", "green", "blue")

SCHEMA = Schema(
    vocabulary=Vocabulary(
        domain="chain",
        actions={
            "Drive": Action("drives", arguments={"to": one_of("where to", ("shelf", "door"))}),
            "Fetch": Action("takes a key", arguments={"key": one_of("which", COLOURS)}),
            "Open": Action("opens the door"),
        },
        keys={
            "place": enumeration("where the robot is", ("yard", "shelf", "door")),
            "lock": enumeration("the lock of the door", COLOURS),
            "held": enumeration("the key that it holds", COLOURS),
            "holding": flag("it holds a key"),
        },
    ),
    components={"work": "doors opened"},
    events={"opened": Event("doors opened")},
    task="A robot opens doors.",
)


class World(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    ticks: int = 40


class Robot:
    """One episode."""

    def __init__(self, _: World, seed: int, log: EventLog) -> None:
        self.log, self.rng = log, np.random.default_rng(seed)
        self.place, self.holding, self.held = "yard", False, COLOURS[0]
        self.lock = COLOURS[self.rng.integers(3)]

    def sense(self) -> dict[str, float]:
        """See `Simulation`."""
        return {key: getattr(self, key) for key in SCHEMA.vocabulary.keys}

    def Drive(self, to: str) -> Iterator[None]:
        """Takes two ticks."""
        if self.place != to:
            yield
        self.place = to
        return True  # type: ignore[return-value] # a generator's

    def Fetch(self, key: str) -> bool:
        """At the shelf."""
        done = self.place == "shelf"
        if done:
            self.holding, self.held = True, key
        return done

    def Open(self) -> bool:
        """At the door, with the key of its lock."""
        done = self.place == "door" and self.holding and self.held == self.lock
        if done:
            self.log("opened")
            self.holding, self.lock = False, COLOURS[self.rng.integers(3)]
        return done


class Chain(SimulatorDomain):
    """The domain."""

    World, Episode, schema = World, Robot, SCHEMA


REWARDS = RewardTable(events={"opened": Reward(component="work", base=10)})


def chain() -> Chain:
    """The domain with its rewards."""
    return Chain(World(), REWARDS)
