"""The courier with NumPy's numbers in all that a domain can return."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from islandgp.domain import Counter, EventLog, Scene, Shape, ShapeStyle, SimulatorDomain
from tests.domains.courier import PLACES, SCHEMA, Day, World


class NumpyDay(Day):
    """An episode whose values have NumPy's types."""

    def __init__(self, world: World, seed: int, log: EventLog) -> None:
        super().__init__(world, seed, log)
        self.ticks = 0

    def sense(self) -> dict[str, Any]:
        """See `Simulation`."""
        return {**super().sense(), "place": np.int64(self.at), "hands": np.int8(self.parcel)}

    def step(self) -> str:
        """See `Simulation`."""
        self.ticks += 1
        return np.str_("")

    def measures(self) -> dict[str, Any]:
        """See `Simulation`."""
        return {"hours": np.float32(self.ticks / 4)}

    def scene(self) -> Scene:
        """See `Simulation`."""
        one = np.float32(1)
        low, high = np.float32(-1), np.float32(len(PLACES))
        robot = Shape("courier", np.float32(self.at), one, one)  # type: ignore[arg-type]
        return Scene((low, low, high, high), movers=(robot,))  # type: ignore[arg-type]

    def Unload(self) -> bool:
        """See `Day`, with an event that has an amount."""
        log = self.log
        self.log = lambda event: log(event, np.float32(1.5))  # type: ignore[assignment, arg-type, return-value]
        unloaded = super().Unload()
        self.log = log
        return np.bool_(unloaded)  # type: ignore[return-value]


class NumpyCourier(SimulatorDomain):
    """The domain."""

    World, Episode = World, NumpyDay
    step_s = np.float32(0.5)  # type: ignore[assignment]
    schema = replace(
        SCHEMA,
        counters={**SCHEMA.counters, "hours": Counter("time at work", "h")},
        styles={"courier": ShapeStyle("the courier", "C")},
    )
