"""Settings of the island, section 2.2.2.

The values are in `conf/world/`; this module defines their meanings and ranges. Lengths are in
metres, times in simulated seconds, charge in percent.
"""

from __future__ import annotations

from math import ceil
from typing import Annotated, Final, Self

from pydantic import BaseModel, Field, model_validator

Positive = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
Percent = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]
WALL: Final = 1.0  # m, half the thickness of a wall, outside the island
ROCK_MARGIN: Final = 0.3  # m between the robot's hull and an obstacle it drives around
MOST_CELLS: Final = 100_000  # of ground; they take 15 ms and 10 MB per world
MOST_CUES: Final = 1_000_000  # most items of garbage, and most turns of humanoids, in a schedule
FAR: Final = 1 << 29  # a step that no episode reaches
MICRO: Final = 1_000_000  # units of charge in one percent
FULL: Final = 100 * MICRO
Point = tuple[NotNegative, NotNegative]  # metres from the south-west corner


class RobotSettings(BaseModel, frozen=True, extra="forbid"):
    """The robot's body, battery and senses."""

    speed: Positive  # m/s while driving
    radius: Positive  # m
    capacity: int = Field(ge=1, le=10_000)  # items of garbage
    perception: Positive  # m, range of camera and LiDAR
    pickup_reach: Positive  # m
    station_reach: Positive  # m, when a charger, clearing point or waypoint counts as reached
    battery_start: Percent
    drain_moving: NotNegative  # %/s
    drain_standing: NotNegative  # %/s
    charge_rate: Positive  # %/s
    charge_below: Percent  # charging starts only below this level
    charge_again: Percent  # charge to be used up before another charging attempt counts
    patrol_segment: Positive  # m, a stretch of patrol in which discoveries are rewarded once


class GarbageSettings(BaseModel, frozen=True, extra="forbid"):
    """Garbage on the ground."""

    initial: int = Field(ge=0, le=20_000)  # items
    every: Positive  # s between new items
    most: int = Field(ge=0, le=20_000)  # items that lie on the ground at once


class HumanoidSettings(BaseModel, frozen=True, extra="forbid"):
    """Humanoids that walk, collect garbage, and ask for clearing."""

    count: int = Field(ge=0, le=1_000)  # that walk about
    speed: Positive  # m/s
    radius: Positive  # m
    turn_every: tuple[Positive, Positive]  # s, least and most between two decisions
    most_items: int = Field(ge=1, le=1_000)  # items carried at most
    ask_from: int = Field(ge=1, le=1_000)  # items from which a humanoid asks
    reach: Positive  # m, distance at which garbage is handed over


class ObstacleSettings(BaseModel, frozen=True, extra="forbid"):
    """Rocks and trees, which are the same in every world."""

    count: int = Field(ge=0, le=500)  # on the island
    radius: tuple[Positive, Positive]  # m, least and most
    gap: Positive  # m of free ground around each
    layout_seed: int = Field(ge=0)  # of the obstacles' places, the same in every world


class EpisodeSettings(BaseModel, frozen=True, extra="forbid"):
    """Limits of an episode."""

    step: Positive  # s a tick and a step of the physics
    length: Positive  # s at most
    stagnation: Positive  # s without a better fitness
    stagnation_low_battery: Positive  # the same while the battery is low
    low_battery: Percent
    negative: Positive  # s of negative fitness


class IslandWorld(BaseModel, frozen=True, extra="forbid"):
    """The settings of an island. With a seed, they define a world."""

    side: Positive  # m
    start: Point
    chargers: tuple[Point, ...] = Field(min_length=1)  # places where robots charge; m
    clearing_points: tuple[Point, ...] = Field(min_length=1)  # places where robots deliver; m
    waypoints: tuple[Point, ...] = Field(min_length=2)
    robot: RobotSettings
    garbage: GarbageSettings
    humanoids: HumanoidSettings
    obstacles: ObstacleSettings
    episode: EpisodeSettings

    @property
    def cell(self) -> float:
        """The width of a cell of ground in metres: the range of perception and two steps.

        So all garbage in sight of a robot in a cell, or one step outside, is in the nine cells.
        """
        return self.robot.perception + 2 * self.robot.speed * self.episode.step

    @property
    def cells(self) -> int:
        """Number of cells of the ground."""
        return ceil(self.side / self.cell) ** 2

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        robot, people, garbage, episode = self.robot, self.humanoids, self.garbage, self.episode
        items = episode.length / max(garbage.every, episode.step)
        turns = people.count * episode.length / max(people.turn_every[0], episode.step)
        for name, value, most, what in (
            ("episode.step", episode.step, episode.length, "s, the episode's length"),
            ("episode.length", episode.length / episode.step, FAR - 1, "steps"),
            ("side", self.cells, MOST_CELLS, "cells to search for garbage"),
            ("garbage.every", items, MOST_CUES, "items in an episode"),
            ("humanoids.turn_every", turns, MOST_CUES, "turns in an episode"),
            ("garbage.initial", garbage.initial, garbage.most, "(garbage.most)"),
            ("humanoids.turn_every", *people.turn_every, "(the second number)"),
            ("obstacles.radius", *self.obstacles.radius, "(the second number)"),
            ("humanoids.ask_from", people.ask_from, people.most_items, "(humanoids.most_items)"),
            ("robot.pickup_reach", robot.pickup_reach, robot.perception, "(robot.perception)"),
            ("humanoids.speed", people.speed, robot.speed, "(robot.speed)"),
            # A faster body could come out on a wall's other side.
            ("episode.step", episode.step, (WALL + robot.radius) / robot.speed, "s"),
            ("episode.step", episode.step, (WALL + people.radius) / people.speed, "s"),
        ):
            if value > most:
                raise ValueError(
                    f"{name}: expected at most {most:,.10g} {what}, found {value:,.10g}"
                )
        if self.obstacles.gap < (narrow := 2 * (robot.radius + ROCK_MARGIN)):
            raise ValueError(
                f"obstacles.gap: expected at least {narrow:g}, so that the robot can pass,"
                f" found {self.obstacles.gap:g}"
            )
        for name, points in (
            ("start", (self.start,)),
            ("chargers", self.chargers),
            ("clearing_points", self.clearing_points),
            ("waypoints", self.waypoints),
        ):
            for x, y in points:
                if not (2 <= x <= self.side - 2 and 2 <= y <= self.side - 2):
                    raise ValueError(
                        f"{name}: expected points at least 2 m inside the {self.side:g} m island,"
                        f" found ({x:g}, {y:g})"
                    )
        return self
