"""A recording as compact plain values for the page: numbers rounded, repeated, told as changes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any, Final

from islandgp.bt.condition import thresholds
from islandgp.bt.node import KEYS
from islandgp.bt.render.label import label
from islandgp.bt.render.layout import lay_out
from islandgp.scoring.rewards import Component
from islandgp.viewer.recording import Recording

LETTERS: Final = ".fsrx"  # a letter per code: idle, failed, succeeded, runs, stopped
PRECISION: Final = 10  # positions are told in tenths of a metre
ROBOT_EVERY: Final = 2  # ticks between two told positions
HUMANOIDS_EVERY: Final = 5


def encode(recording: Recording, *, title: str) -> dict[str, Any]:
    """What the page's script reads; `page/data.js` is its counterpart."""
    world, episode = recording.world, recording.episode
    return {
        "title": title,
        "seed": recording.seed,
        "stage": recording.stage + 1,
        "ticks": recording.ticks,
        "step": world.episode.step,
        "ending": episode.ending.value,
        "fitness": episode.fitness,
        "side": world.side,
        "perception": world.robot.perception,
        "radius": {"robot": world.robot.radius, "humanoid": world.humanoids.radius},
        "reach": world.robot.station_reach,
        "capacity": world.robot.capacity,
        "asks": world.humanoids.ask_from,
        "rocks": [[round(v, 2) for v in rock] for rock in recording.rocks],
        "chargers": world.chargers,
        "clearing": world.clearing_points,
        "waypoints": world.waypoints,
        "robot": _way(recording.robot, ROBOT_EVERY),
        "goals": _changes(
            None if goal is None else [round(goal.real, 1), round(goal.imag, 1)]
            for goal in recording.goals
        ),
        "humanoids": [_way(column.tolist(), HUMANOIDS_EVERY) for column in recording.humanoids.T],
        "carried": [_changes(line) for line in zip(*recording.carried, strict=True)],
        "garbage": [
            [round(x * PRECISION), round(y * PRECISION), begin, end]
            for x, y, begin, end in recording.garbage
        ],
        "board": [
            {
                "key": name,
                "flag": key.flag,
                "meaning": key.meaning,
                "marks": [] if key.flag else thresholds(recording.tree, name),
                "changes": _changes(round(board[place], 1) for board in recording.boards),
            }
            for place, (name, key) in enumerate(KEYS.items())
        ],
        "components": [component.name.lower() for component in Component],
        "credits": [
            [c.tick, int(c.component), round(c.points, 2), c.event.name.lower()]
            for c in recording.credits
            if c.points
        ],
        "nodes": [
            {"kind": box.node.kind, "label": label(box.node), "parent": box.parent}
            for box in lay_out(recording.tree)[0]
        ],
        "statuses": [runs(line) for line in recording.statuses],
    }


def runs(codes: bytes) -> str:
    """Codes as letters, each with how often it is repeated: `r3fr` is running thrice, ..."""
    told = []
    for code, group in groupby(codes):
        count = sum(1 for _ in group)
        told.append(LETTERS[code] + (str(count) if count > 1 else ""))
    return "".join(told)


def _way(positions: Sequence[complex], every: int) -> dict[str, Any]:
    """Every so many-th position and the last one, as differences in tenths of a metre."""
    told = [*positions[::every], positions[-1]]
    return {
        "every": every,
        "x": _differences([round(at.real * PRECISION) for at in told]),
        "y": _differences([round(at.imag * PRECISION) for at in told]),
    }


def _differences(values: list[int]) -> list[int]:
    return [after - before for before, after in zip([0, *values], values, strict=False)]


def _changes(values: Iterable[Any]) -> list[Any]:
    """[tick, value, ticks since then, value, ...]: only where the value changes."""
    told: list[Any] = []
    last, before = 0, object()
    for tick, value in enumerate(values):
        if value != before:
            told += [tick - last, value]
            last, before = tick, value
    return told
