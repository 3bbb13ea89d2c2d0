"""MiniGrid as a domain: an episode is a level, chosen by the world's seed."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, Final, Self

from pydantic import BaseModel, Field

from grid_robot import GridRobot, levels, mission
from islandgp.domain import EventLog, RewardTable, Schema, Simulation, SimulatorDomain
from islandgp.errors import ConfigError

SCHEMA: Final = Schema.read(Path(__file__).with_name("schema.yaml"))


class Levels(BaseModel, frozen=True, extra="forbid"):
    """The configuration group `world`."""

    levels: tuple[str, ...] = Field(min_length=1)
    """MiniGrid's names without `MiniGrid-` and the version; a seed selects one of them."""
    ticks: int = Field(ge=1, le=10_000)  # steps of an episode, at most; a level may have fewer


class MiniGrid(SimulatorDomain):
    """The MiniGrid domain."""

    World: ClassVar[type[BaseModel]] = Levels
    Episode: ClassVar[Callable[[Any, int, EventLog], Simulation]] = GridRobot
    schema: Schema = SCHEMA

    @classmethod
    def make(cls, world: Levels, rewards: RewardTable) -> Self:
        """See `Domain`. Raises ConfigError if MiniGrid or a level is missing."""
        if find_spec("minigrid") is None:
            raise ConfigError(
                "domain=minigrid: expected the package minigrid, found none; install it with"
                " pip install minigrid."
            )
        names = list(levels())
        for level in world.levels:
            if level not in names:
                near = get_close_matches(level, names, 1, 0.4)
                hint = f"did you mean {near[0]}?" if near else f"there is, e.g., {names[0]}"
                raise ConfigError(
                    f"world.levels: expected levels of MiniGrid without moving obstacles, found"
                    f" {level!r};"
                    f" {hint}"
                )
        return cls(world, rewards)

    def about(self, seed: int | None = None) -> str:
        """See `Domain`: the levels, with a mission each."""
        if seed is not None:
            level = self.world.levels[seed % len(self.world.levels)]
            return f"The level is {level}, its mission: {mission(level, seed)}."
        levels = "; ".join(f"{level} ({mission(level, 0)})" for level in self.world.levels)
        return f"{super().about()} The levels, each with a mission that it may have: {levels}."
