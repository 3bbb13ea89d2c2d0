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

    @model_validator(mode="after")
    def _comes_to_an_end(self) -> Self:
        if self.step > self.length:
            raise ValueError(
                f"expected a step of at most the length, {self.length:g} s, found {self.step:g} s;"
                " shorten step or lengthen length"
            )
        if self.length / self.step >= FAR:
            raise ValueError(
                f"expected fewer than {FAR:,} steps, found {self.length:g} s in steps of"
                f" {self.step:g} s; shorten length or lengthen step"
            )
        return self


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
    def _fits_into_memory(self) -> Self:
        if self.cells > MOST_CELLS:
            raise ValueError(
                f"side: expected at most {MOST_CELLS:,} cells of {self.cell:g} m to search for"
                f" garbage, found {self.cells:,} on an island of {self.side:g} m; take"
                " a smaller side or a larger robot.perception"
            )
        length, step = self.episode.length, self.episode.step
        often = self.humanoids.count
        for name, number in (
            ("garbage.every", length / max(self.garbage.every, step)),
            ("humanoids.turn_every", often * length / max(self.humanoids.turn_every[0], step)),
        ):
            if number > MOST_CUES:
                raise ValueError(
                    f"{name}: expected at most {MOST_CUES:,} of these in an episode, found"
                    f" {number:,.0f}; raise it, or shorten episode.length"
                )
        return self

    @model_validator(mode="after")
    def _points_are_inside(self) -> Self:
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

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.garbage.initial > self.garbage.most:
            raise ValueError(
                f"garbage.initial: expected at most garbage.most={self.garbage.most},"
                f" found {self.garbage.initial}"
            )
        narrow = 2 * (self.robot.radius + ROCK_MARGIN)
        if self.obstacles.gap < narrow:
            raise ValueError(
                f"obstacles.gap: expected at least {narrow:g}, so that the robot can pass,"
                f" found {self.obstacles.gap:g}"
            )
        for name, (low, high) in (
            ("humanoids.turn_every", self.humanoids.turn_every),
            ("obstacles.radius", self.obstacles.radius),
        ):
            if low > high:
                raise ValueError(f"{name}: expected least before most, found [{low:g}, {high:g}]")
        if self.humanoids.ask_from > self.humanoids.most_items:
            raise ValueError(
                "humanoids.ask_from: expected at most humanoids.most_items="
                f"{self.humanoids.most_items}, found {self.humanoids.ask_from}"
            )
        if self.robot.pickup_reach > self.robot.perception:
            raise ValueError(
                f"robot.pickup_reach: expected at most robot.perception={self.robot.perception:g},"
                f" found {self.robot.pickup_reach:g}"
            )
        for name, body in (("robot", self.robot), ("humanoids", self.humanoids)):
            most = WALL + body.radius
            if body.speed * self.episode.step > most:  # it could come out on a wall's other side
                raise ValueError(
                    f"episode.step: expected at most {most / body.speed:g} s ({most:g} m at"
                    f" {name}.speed), found {self.episode.step:g} s; lower one of them"
                )
        if self.humanoids.speed > self.robot.speed:
            raise ValueError(
                f"humanoids.speed: expected at most robot.speed={self.robot.speed:g},"
                f" found {self.humanoids.speed:g}"
            )
        return self
