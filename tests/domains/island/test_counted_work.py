"""What a fixed episode takes, counted: a guard against slowness that no busy machine can upset.

The bounds are a tenth above what was counted when they were last set. Who makes
episodes cheaper lowers them; a commit that raises one gives the reason.
"""

from __future__ import annotations

import gc
import sys
from collections import Counter
from types import FrameType
from typing import Any

import pytest

from islandgp.bt.core.language import parse
from islandgp.resources import resource
from tests.domains.island.days import Episode, points, run_episode, world

ALL_ROUNDER = {"ticks": 270, "python": 5_350, "builtin": 1_250}
"""The most that a full-length episode of the all-rounder may take."""

WAITING = "selector { MoveToHumanoid when batteryLevel < 5 { ExecuteCharge } }"

ENDING = "parallel success one { PatrolWaypoint inverter { MoveToHumanoid } PickupGarbage }"


def all_rounder() -> str:
    """The example of that name."""
    return (resource("grammar") / "examples" / "all_rounder.bt").read_text(encoding="utf-8")


def counted(text: str, *, stepwise: bool = False) -> tuple[Episode, Counter[str]]:
    """An episode of seed 0 on the paper's island, and how often what was called in it.

    `ticks`: the tree; `python`: functions of Python; `builtin`: functions of C.
    """
    counter: Counter[str] = Counter()

    def note(_frame: FrameType, event: str, _called: Any) -> None:
        counter["python"] += event == "call"
        counter["builtin"] += event == "c_call"

    tree, island, award = parse(text), world(), points()
    run_episode(tree, island, 0, award)  # what is made once for a world is there from now on
    before = sys.getprofile()
    gc.collect()  # else what earlier tests left behind is freed, and counted, in this episode
    gc.disable()
    sys.setprofile(note)
    try:
        episode = run_episode(tree, island, 0, award, stepwise=stepwise)
    finally:
        sys.setprofile(before)
        gc.enable()
    counter["ticks"] = episode.ticks
    return episode, counter


def test_work_of_the_all_rounder() -> None:
    """A full-length episode: 4,200 steps with few ticks and calls."""
    episode, counter = counted(all_rounder())
    assert episode.steps == 4200
    for name, most in ALL_ROUNDER.items():
        assert 0 < counter[name] <= most, name


def test_work_of_a_robot_that_waits() -> None:
    """Nobody asks a tree again that waits for something that does not come."""
    episode, counter = counted(WAITING)
    assert episode.steps >= 600
    assert episode.ticks <= 2
    assert counter["python"] <= 1.2 * episode.steps


def test_work_of_a_tree_that_ends_in_each_tick() -> None:
    """A tick that ends while the robot drives is repeated by the next ones, which are left out."""
    episode, counter = counted(ENDING)
    assert episode.steps >= 1200
    assert episode.ticks <= 0.1 * episode.steps
    assert counter["python"] <= 2 * episode.steps


@pytest.mark.slow
def test_counting_sees_more_work() -> None:
    """The same episode step by step takes many times the calls, so the counts mean something."""
    _, quick = counted(all_rounder())
    _, slow = counted(all_rounder(), stepwise=True)
    for name in ("ticks", "python"):
        assert slow[name] > 3 * quick[name], name
