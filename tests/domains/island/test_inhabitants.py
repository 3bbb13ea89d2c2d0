"""Garbage, humanoids and collisions."""

from __future__ import annotations

from itertools import pairwise
from math import hypot

import pytest

from islandgp.domains.island.schedule import draw_schedule
from tests.domains.island.conftest import Lay
from tests.domains.island.days import day, world


def test_garbage_is_capped(lay: Lay) -> None:
    """At most 150 items lie on the ground at once; what would be more never appears."""
    many = [complex(10 + i % 90, 10 + i // 90) for i in range(140)]
    lay(garbage=many, spawns=[(step, 250.0, 250.0) for step in range(1, 60)])
    trace = day("PatrolWaypoint", world(episode={"length": 8}))
    assert max(moment.lying for moment in trace.moments) == 150
    assert trace.amounts("leftover") == [150]


def test_new_garbage_appears_when_there_is_room(lay: Lay) -> None:
    """On a full ground a pickup makes room for the next item."""
    lay(garbage=[150 + 150j, 10 + 10j], spawns=[(5, 20.0, 20.0), (6, 30.0, 30.0)])
    trace = day("PickupGarbage", world(garbage={"initial": 2, "most": 2}, episode={"length": 2}))
    assert trace.amounts("leftover") == [2]


def test_spawning_as_configured() -> None:
    """120 items at the start, one more every 2 s, up to 150."""
    trace = day("PatrolWaypoint", world(episode={"length": 100, "negative": 100}))
    pickups = len(trace.amounts("pickup"))
    assert pickups == 0
    assert [trace.moments[step].lying for step in (0, 20, 21, 41, 599, 601, 990)] == [
        120, 120 + 1, 121, 122, 149, 150, 150,
    ]  # fmt: skip


def test_humanoids_carry_ten_and_ask_from_five() -> None:
    """Over a whole day nobody carries more than 10, and who is in sight asks from 5 on."""
    trace = day("PatrolWaypoint", world(robot={"drain_moving": 0}, episode={"negative": 420}))
    carried = [count for moment in trace.moments for count in moment.carried]
    assert min(carried) == 0
    assert max(carried) == 10
    assert not any(moment.board[4] for moment in trace.moments if max(moment.carried) < 5)
    assert any(moment.board[4] for moment in trace.moments)


def test_humanoids_find_an_item_every_4_to_10_seconds() -> None:
    """Between two items of a humanoid there are 4 to 10 s."""
    island = world()
    schedule = draw_schedule(island, 3)
    for h in range(island.humanoids.count):
        steps = [
            0,
            *(step for step, humanoid, _, _ in schedule.turns[:-1].tolist() if humanoid == h),
        ]
        gaps = [b - a for a, b in pairwise(steps)]
        assert len(gaps) > 40
        assert min(gaps) >= 40
        assert max(gaps) <= 100


def test_humanoids_walk_at_their_speed() -> None:
    """A heading is a velocity of 1.2 m/s in some direction."""
    schedule = draw_schedule(world(), 3)
    speeds = [hypot(vx, vy) for vx, vy in schedule.humanoids[["vx", "vy"]].tolist()]
    speeds += [hypot(vx, vy) for _, _, vx, vy in schedule.turns[:-1].tolist()]
    assert speeds == [pytest.approx(1.2)] * len(speeds)


def test_a_contact_is_one_collision(lay: Lay) -> None:
    """A robot that runs into a humanoid and pushes on collides once, as long as they touch."""
    lay(humanoids=[(150, 160)])
    trace = day("PatrolWaypoint", world(waypoints=[[150, 200], [150, 210]], episode={"length": 12}))
    touching = [0 in moment.touching for moment in trace.moments]
    contacts = sum(now and not before for before, now in pairwise([False, *touching]))
    assert contacts >= 1
    # A contact that begins and ends between two looks is one, too.
    assert len(trace.amounts("collision")) >= contacts
    assert len(trace.amounts("collision")) <= 3


def test_a_standing_robot_can_be_touched(lay: Lay) -> None:
    """A humanoid that walks into a robot is a collision, and then walks away from it."""
    lay(humanoids=[(150, 155)], turns=[(1, 0, 0.0, -1.2)])
    trace = day("PickupGarbage", world(episode={"length": 15}))
    assert trace.amounts("collision") == [1]
    # 5 m less the two radii of 0.6 and 0.4 m, at 1.2 m/s
    assert trace.steps("collision") == [pytest.approx(1 + 4 / 0.12, abs=2)]
    assert 0 not in trace.moments[-1].touching


def test_no_collision_without_a_humanoid_nearby(lay: Lay) -> None:
    """Humanoids on the other side of the island are none of its business."""
    lay(humanoids=[(20, 20), (280, 280)])
    trace = day("PatrolWaypoint", world(waypoints=[[150, 170], [150, 130]], episode={"length": 60}))
    assert trace.amounts("collision") == []


def test_things_have_room() -> None:
    """Garbage and humanoids start on free ground: clear of rocks and walls."""
    island = world()
    for seed in range(20):
        schedule = draw_schedule(island, seed)
        garbage = [complex(x, y) for x, y in schedule.garbage[["x", "y"]].tolist()]
        people = [complex(x, y) for x, y in schedule.humanoids[["x", "y"]].tolist()]
        assert (schedule.initial, len(garbage)) == (120, 120 + 210)
        for z in (*garbage, *people):
            assert 1.6 <= z.real <= 298.4
            assert 1.6 <= z.imag <= 298.4
            assert all(abs(z - complex(x, y)) > r + 1.6 for x, y, r in schedule.obstacles)
