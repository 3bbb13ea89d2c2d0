"""An episode is a function of tree, world, seed and award, and skipping steps changes nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node, within
from islandgp.domains.island import episode
from islandgp.domains.island.space import idle_spaces
from islandgp.domains.island.state import State
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import IslandWorld
from islandgp.gp.random_trees import random_tree
from tests.composed import composed_plan
from tests.domains.island.conftest import Lay
from tests.domains.island.days import Episode, day, points, run_episode, world
from tests.domains.island.odd import odd_worlds
from tests.goldens import check_golden
from tests.profiles import examples, sweep
from tests.strategies import nodes

LIMITS = Limits(max_depth=8, max_nodes=50)
ALL_ROUNDER = """
selector {
  when batteryLevel < 20 abort lower { sequence { SeekCharger ExecuteCharge } }
  when robotCurrentExtraCapacity <= 5 { DeliverToClearingPoint }
  when isHumanoidWantToClear { MoveToHumanoid }
  when foundGarbage { sequence { MoveToGarbage PickupGarbage } }
  PatrolWaypoint
}
"""
RESTLESS = """
parallel success all failure all {
  repeater 5 { sequence { MoveToGarbage PickupGarbage } }
  when batteryLevel < 60 abort both { parallel { SeekCharger PatrolWaypoint } }
  selector { MoveToHumanoid when lap >= 1 { DeliverToClearingPoint } PatrolWaypoint }
}
"""


def both_ways(tree: Node, island: IslandWorld, seed: int) -> tuple[Episode, Episode]:
    """The episode in one go and step by step; ticks are a cost and may differ."""
    quick = run_episode(tree, island, seed, points())
    slow = run_episode(tree, island, seed, points(), stepwise=True)
    assert quick.ticks <= slow.ticks
    return replace(quick, ticks=0), replace(slow, ticks=0)


def same_both_ways(tree: Node, island: IslandWorld, seed: int) -> None:
    """Both are the same, if the tree is one that can be run."""
    if within(tree, LIMITS):
        quick, slow = both_ways(tree, island, seed)
        assert quick == slow


def busy() -> IslandWorld:
    """A small island where much happens: contacts, rocks, thresholds."""
    return world(
        side=120,
        start=[60, 60],
        chargers=[[20, 20], [100, 100]],
        clearing_points=[[20, 100]],
        waypoints=[[60, 20], [100, 60], [60, 100], [20, 60]],
        humanoids={"count": 12},
        obstacles={"count": 8},
        episode={"length": 150},
    )


def gp_tree(seed: int) -> Node:
    """A tree as genetic programming begins with."""
    return random_tree(np.random.default_rng(seed), replace(composed_plan().space, limits=LIMITS))


@sweep("seed", range(8), quick=3)
def test_stepwise_is_the_same_for_random_trees(seed: int) -> None:
    """Skipping the steps at which nothing can change gives the same episode to the last bit."""
    quick, slow = both_ways(gp_tree(seed), busy(), seed)
    assert quick == slow


@examples(max_examples=20)
@given(tree=nodes(max_leaves=10, max_repeats=3, pairs=True), seed=st.integers(0, 5))
def test_stepwise_is_the_same_for_any_tree(tree: Node, seed: int) -> None:
    """The same for trees that no genetic programming would think of."""
    same_both_ways(tree, busy(), seed)


@pytest.mark.parametrize("tree", [ALL_ROUNDER, RESTLESS], ids=["all-rounder", "restless"])
def test_stepwise_is_the_same_on_the_island(tree: str) -> None:
    """The same over the whole 420 s on the large island."""
    quick, slow = both_ways(parse(tree), world(), 4)
    assert quick == slow


def test_a_comparison_with_the_battery_is_seen_at_its_step() -> None:
    """The battery falls below another key between two events; that step is not skipped."""
    tree = parse(
        "selector { when batteryLevel < robotCurrentExtraCapacity { SeekCharger } PatrolWaypoint }"
    )
    quick, slow = both_ways(tree, world(), 2)
    assert quick == slow


ENDING_WHILE_DRIVING = (
    "PatrolWaypoint inverter { ExecuteCharge }",
    "PatrolWaypoint inverter { PickupGarbage }",
    "PatrolWaypoint inverter { MoveToGarbage }",
    "PatrolWaypoint inverter { sequence { MoveToGarbage MoveToHumanoid } }",
    "PatrolWaypoint SeekCharger inverter { DeliverToClearingPoint }",
    "PatrolWaypoint MoveToHumanoid inverter { PickupGarbage }",
    "PatrolWaypoint MoveToGarbage inverter { ExecuteCharge }",
    "PatrolWaypoint inverter { MoveToHumanoid } MoveToGarbage",
    "PatrolWaypoint inverter { MoveToHumanoid } SeekCharger",
    "MoveToGarbage inverter { ExecuteCharge } DeliverToClearingPoint",
    *(f"PatrolWaypoint selector {{ {name} SeekCharger }}" for name in VOCABULARY.actions),
    *(f"PatrolWaypoint inverter {{ {name} }} MoveToGarbage" for name in VOCABULARY.actions),
)


def on_the_way(**places: list[list[float]]) -> IslandWorld:
    """Stations on the patrol, rocks between them, little garbage at first, and a low battery."""
    stations = {
        "chargers": [[40, 22], [80, 20], [100, 90]],
        "clearing_points": [[62, 19], [60, 101]],
        "waypoints": [[20, 20], [100, 20], [100, 100], [20, 100]],
    }
    return world(
        side=120,
        start=[60, 60],
        **(stations | places),
        robot={"battery_start": 60},
        garbage={"initial": 5, "every": 0.3, "most": 40},
        humanoids={"count": 12},
        obstacles={"count": 14, "radius": [3, 6], "gap": 3.5},
        episode={"length": 150},
    )


@sweep("seeds", [(0,), pytest.param((1, 2, 3, 4, 5), marks=pytest.mark.slow)], quick=2)
@sweep("branches", ENDING_WHILE_DRIVING, quick=6)
def test_stepwise_is_the_same_where_ticks_end_while_the_robot_drives(
    branches: str, seeds: Sequence[int]
) -> None:
    """A parallel that ends in each tick, and turns the wheels in each: few ticks are needed."""
    tree, island = parse(f"parallel success one {{ {branches} }}"), on_the_way()
    for seed in seeds:
        quick, slow = both_ways(tree, island, seed)
        assert quick == slow, seed


def test_stepwise_is_the_same_on_a_detour() -> None:
    """On the way around a rock another item becomes the nearest."""
    tree = parse("parallel success one { inverter { SeekCharger } MoveToGarbage PickupGarbage }")
    island = on_the_way(
        chargers=[[20, 20], [100, 100]],
        clearing_points=[[20, 100], [90, 30]],
        waypoints=[[60, 20], [100, 60], [60, 100], [20, 60]],
    )
    for seed in (0, 29):  # where it does: found among a hundred
        quick, slow = both_ways(tree, island, seed)
        assert quick == slow, seed


def plain(**changes: Any) -> IslandWorld:
    """A small island with nobody and nothing on it but stations."""
    return world(
        **{
            "side": 120,
            "start": [60, 60],
            "chargers": [[20, 20], [100, 100]],
            "clearing_points": [[20, 100]],
            "waypoints": [[60, 20], [100, 60], [60, 100], [20, 60]],
            "garbage": {"initial": 0, "every": 1000, "most": 100},
            "humanoids": {"count": 0},
            "obstacles": {"count": 0},
            "episode": {"length": 60},
        }
        | changes
    )


LITTER = {"initial": 40, "every": 1000, "most": 100}
GRID = [[x, y] for x in range(10, 120, 10) for y in range(10, 120, 10) if (x, y) != (60, 60)]
BENDS = [[20, 20], [100, 60], [60, 100], [22, 70], [90, 20], [25, 100]]

RARE_CASES = {
    # cases that a search or reasoning found once: tree, world
    "leaves share an item": (
        "parallel { MoveToGarbage sequence { SeekCharger MoveToGarbage } }", busy()),
    "leaves share a charger": (
        "parallel success all failure all { SeekCharger sequence { MoveToGarbage SeekCharger } }",
        plain(chargers=GRID, start=[55, 55], robot={"station_reach": 4},
              garbage={"initial": 60, "every": 1000, "most": 100})),
    "two clearing points in reach": (
        "parallel success one { PatrolWaypoint inverter { DeliverToClearingPoint } }",
        plain(waypoints=[[100, 60], [20, 60]], clearing_points=[[70, 60], [71, 60]])),
    "a goal that is overshot": (
        "parallel success one { MoveToGarbage inverter { ExecuteCharge } }",
        plain(garbage=LITTER, robot={"pickup_reach": 0.2})),
    "a humanoid that runs": (
        "MoveToHumanoid",
        plain(humanoids={"count": 6, "speed": 3, "reach": 0.3, "ask_from": 1})),
    "out of reach and back around a rock": (
        "selector { when lap >= 99 { SeekCharger } parallel success one failure all {"
        " sequence { inverter { DeliverToClearingPoint } PatrolWaypoint } } }",
        plain(start=[60, 50], clearing_points=[[60, 60]], waypoints=BENDS,
              robot={"station_reach": 24}, episode={"length": 150},
              obstacles={"count": 10, "radius": [4, 8], "gap": 1.9, "layout_seed": 13})),
    "a charge too small to count": (
        "sequence { SeekCharger ExecuteCharge }",
        plain(start=[21, 20], robot={"charge_rate": 1e-6})),
}  # fmt: skip


@pytest.mark.parametrize("name", RARE_CASES)
def test_stepwise_is_the_same_where_it_once_was_not(name: str) -> None:
    """Each of these differed, or failed one way only, before the island knew of it."""
    text, island = RARE_CASES[name]
    for seed in range(6):
        quick, slow = both_ways(parse(text), island, seed)
        assert quick == slow, seed


@examples(
    max_examples=25, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
)
@given(tree=nodes(max_leaves=8, max_repeats=3), island=odd_worlds(), seed=st.integers(0, 9))
def test_stepwise_is_the_same_in_odd_worlds(tree: Node, island: IslandWorld, seed: int) -> None:
    """The same in worlds that nobody would set up."""
    same_both_ways(tree, island, seed)


@pytest.mark.slow
@settings(
    max_examples=1500, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
)
@given(tree=nodes(max_leaves=12, max_repeats=3), island=odd_worlds(), seed=st.integers(0, 20))
def test_stepwise_is_the_same_in_odd_worlds_often(
    tree: Node, island: IslandWorld, seed: int
) -> None:
    """The same in hundreds of them."""
    same_both_ways(tree, island, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_stepwise_is_the_same_often(seed: int) -> None:
    """The same for two hundred trees, on both islands."""
    for island in (busy(), world()):
        quick, slow = both_ways(gp_tree(1000 + seed), island, seed % 7)
        assert quick == slow, to_text(gp_tree(1000 + seed))


@pytest.mark.slow
@examples(max_examples=300)
@given(tree=nodes(max_leaves=16, max_repeats=5), seed=st.integers(0, 20))
def test_stepwise_is_the_same_for_any_tree_often(tree: Node, seed: int) -> None:
    """The same for three hundred odd trees."""
    same_both_ways(tree, busy(), seed)


def test_crowded_episodes_are_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a body touches two others at once, the outcome is that of every step."""
    people = world().humanoids.model_copy(update={"count": 40, "speed": 9.0})
    island, begun = world().model_copy(update={"humanoids": people}), []

    class Counted(State):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            begun.append(self.may_coast)

    monkeypatch.setattr(episode, "State", Counted)
    for seed in range(8):
        quick, slow = both_ways(parse(ALL_ROUNDER), island, seed)
        assert quick == slow, seed
    assert begun.count(0) > 8 == begun.count(1)


def test_skipping_is_worth_it() -> None:
    """The all-rounder is ticked in a small part of the steps."""
    episode = run_episode(parse(ALL_ROUNDER), world(), 0, points())
    assert episode.ticks < episode.steps / 2


def test_earlier_episodes_leave_no_trace() -> None:
    """The same episode before and after others, in other worlds."""
    tree, island = parse(ALL_ROUNDER), busy()
    before = run_episode(tree, island, 3, points())
    for seed in range(3):
        run_episode(gp_tree(seed), world(episode={"length": 30}), seed, points())
        run_episode(tree, island, 4, points())
    assert run_episode(tree, island, 3, points()) == before


def test_an_overlap_at_the_end_leaves_no_trace(lay: Lay) -> None:
    """A space is used again as if it were new, also where its bodies were being pushed apart."""
    island, tree = world(episode={"length": 1}), "selector { PatrolWaypoint }"
    idle_spaces.cache_clear()
    lay(humanoids=[(200, 200)])
    fresh = day(tree, island).moments
    lay(humanoids=[(150.05, 145.5)])
    assert day(tree, island).moments[-1].touching
    lay(humanoids=[(200, 200)])
    assert day(tree, island).moments == fresh


def test_seeds_differ() -> None:
    """Another seed is another day."""
    tree, island = parse(ALL_ROUNDER), busy()
    fitness = {run_episode(tree, island, seed, points()).fitness for seed in range(4)}
    assert len(fitness) == 4


@pytest.mark.process
def test_another_process() -> None:
    """Another process, with another hash seed, comes to the same episode."""
    code = (
        "from islandgp.bt.core.language import parse\n"
        "from tests.domains.island.days import points, run_episode\n"
        "from tests.domains.island.test_determinism import ALL_ROUNDER, busy\n"
        "print(run_episode(parse(ALL_ROUNDER), busy(), 5, points()))\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[3],
        env={**os.environ, "PYTHONHASHSEED": "12345", "PYTHONPATH": "."},
        capture_output=True,
        text=True,
        check=True,
    )
    episode = run_episode(parse(ALL_ROUNDER), busy(), 5, points())
    assert process.stdout == f"{episode}\n"


def test_all_rounder_golden() -> None:
    """One day of the all-rounder on the paper's island, as last reviewed."""
    episode = run_episode(parse(ALL_ROUNDER), world(), 2024, points())
    plain = asdict(episode)
    del plain["ticks"]
    events = [(step, event.upper(), amount) for step, event, amount in episode.events]
    plain["counts"] = dict(sorted(Counter(event for _, event, _ in events).items()))
    plain["events"] = [f"{step} {event} {amount:g}" for step, event, amount in events]
    check_golden("all_rounder_episode.json", json.dumps(plain, indent=1) + "\n")
