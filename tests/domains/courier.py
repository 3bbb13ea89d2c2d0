"""A domain of words: a courier who carries parcels from the depot to a house."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from islandgp.bt.core.parameters import one_of
from islandgp.bt.core.vocabulary import Action, Vocabulary, enumeration
from islandgp.domain import Event, EventLog, Schema, SimulatorDomain

PLACES = ("road", "depot", "house")
HANDS = ("empty", "parcel")

SCHEMA = Schema(
    vocabulary=Vocabulary(
        "courier",
        {
            "Drive": Action("drives to a place", arguments={"to": one_of("where to", PLACES)}),
            "Load": Action("loads a parcel"),
            "Unload": Action("unloads the parcel"),
        },
        {
            "place": enumeration("where the courier is", PLACES),
            "before": enumeration("where the courier was", PLACES),
            "hands": enumeration("what the courier holds", HANDS),
        },
    ),
    components={"parcels": "parcels loaded and delivered"},
    events={"loaded": Event("parcels loaded"), "delivered": Event("parcels delivered")},
    task="Carry parcels from the depot to the house.",
)


class World(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    ticks: int = Field(default=40, ge=1)


class Day:
    """One episode; the seed is the place where it begins."""

    def __init__(self, world: World, seed: int, log: EventLog) -> None:
        del world
        self.log = log
        self.at, self.before, self.parcel = seed % 3, 0, False

    def sense(self) -> dict[str, Any]:
        """See `Simulation`."""
        return {
            "place": PLACES[self.at],
            "before": PLACES[self.before],
            "hands": HANDS[self.parcel],
        }

    def step(self) -> str:
        """See `Simulation`."""
        return ""

    def Drive(self, to: str) -> bool:
        """From the road to any place, from any place to the road."""
        if (self.at == 0) == (to == "road"):
            return False
        self.before, self.at = self.at, PLACES.index(to)
        return True

    def Load(self) -> bool:
        """At the depot, with empty hands."""
        if PLACES[self.at] != "depot" or self.parcel:
            return False
        self.parcel = True
        self.log("loaded")
        return True

    def Unload(self) -> bool:
        """At the house, with a parcel."""
        if PLACES[self.at] != "house" or not self.parcel:
            return False
        self.parcel = False
        self.log("delivered")
        return True


class Courier(SimulatorDomain):
    """The domain."""

    World, Episode, schema = World, Day, SCHEMA
