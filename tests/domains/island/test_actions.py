"""The seven actions: when each runs, succeeds and fails, and what it writes down."""

from __future__ import annotations

from itertools import pairwise

import pytest

from islandgp.domains.island.events import IslandEvent
from islandgp.domains.island.schedule import Turn
from islandgp.domains.island.world import IslandWorld
from tests.domains.island.conftest import Lay
from tests.domains.island.days import day, world

FOUND, ASKED = 3, 4  # places on the blackboard


def short(seconds: float = 10, **changes: object) -> IslandWorld:
    """Short episodes; the robot starts at (150, 150) and drives 0.5 m a step."""
    return world(episode={"length": seconds}, **changes)


def asking(*people: int, items: int = 5, first: int = 1) -> list[Turn]:
    """Cues after which humanoids carry so many items; one is found at each step."""
    return [(first + n, h, 0.0, 0.0) for n in range(items) for h in people]


# MoveToGarbage


def test_move_to_garbage_arrives(lay: Lay) -> None:
    """It drives until the item is within 1.5 m: 8.5 of 10 m are 17 steps."""
    lay(garbage=[160 + 150j])
    found = day("MoveToGarbage", short())
    assert found.statuses[:18] == ["RUNNING"] * 17 + ["SUCCESS"]
    assert found.moments[17].x == pytest.approx(158.5)


@pytest.mark.parametrize(("x", "seen"), [(164.9, True), (165, True), (165.01, False), (200, False)])
def test_garbage_in_sight(lay: Lay, x: float, seen: bool) -> None:
    """Perception reaches 15 m, that included; beyond it MoveToGarbage fails."""
    lay(garbage=[complex(x, 150)])
    first = day("MoveToGarbage", short()).moments[0]
    assert first.board[FOUND] == seen
    assert first.status == ("RUNNING" if seen else "FAILURE")


def test_move_to_garbage_takes_the_nearest(lay: Lay) -> None:
    """Of several items it drives to the nearest, and keeps to it."""
    lay(garbage=[150 + 162j, 159 + 150j, 150 + 139j], spawns=[(3, 150.0, 153.0)])
    found = day("MoveToGarbage", short())
    arrival = found.moments[found.statuses.index("SUCCESS")]
    assert (arrival.x, arrival.y) == (pytest.approx(157.5), pytest.approx(150))


# PickupGarbage


@pytest.mark.parametrize(("x", "reached"), [(150, True), (151.5, True), (151.51, False)])
def test_pickup_reach(lay: Lay, x: float, reached: bool) -> None:
    """It takes an item within 1.5 m at once, and nothing farther away."""
    lay(garbage=[complex(x, 150)])
    found = day("PickupGarbage", short(1))
    assert found.statuses[0] == ("SUCCESS" if reached else "FAILURE")
    assert found.amounts(IslandEvent.PICKUP) == [1] * reached
    assert found.amounts(IslandEvent.LEFTOVER) == [1 - reached]


def test_one_item_is_picked_up_once(lay: Lay) -> None:
    """Twice in a tick can't take the same item."""
    lay(garbage=[150.5 + 150j])
    found = day("sequence { PickupGarbage PickupGarbage }", short(1))
    assert found.statuses[0] == "FAILURE"
    assert (found.amounts(IslandEvent.PICKUP), found.moments[-1].load) == ([1], 1)


def test_two_items_in_a_tick(lay: Lay) -> None:
    """Two items in reach can be taken in one tick, each once."""
    lay(garbage=[150.5 + 150j, 149.5 + 150j])
    found = day("parallel { PickupGarbage PickupGarbage }", short(1))
    assert found.statuses[:2] == ["SUCCESS", "FAILURE"]
    assert found.steps(IslandEvent.PICKUP) == [0, 0]


def test_full_robot_picks_nothing_up(lay: Lay) -> None:
    """Without room PickupGarbage fails, and the item stays."""
    lay(garbage=[150.5 + 150j, 149.5 + 150j, 150 + 150.5j])
    found = day("PickupGarbage", short(1, robot={"capacity": 2}))
    assert found.statuses[:4] == ["SUCCESS", "SUCCESS", "FAILURE", "FAILURE"]
    assert [moment.board[1] for moment in found.moments[:4]] == [2, 1, 0, 0]
    assert found.moments[-1].lying == 1


# SeekCharger, ExecuteCharge


def test_seek_charger(lay: Lay) -> None:
    """It drives to the nearest charger until it is within 2 m: 18 of 20 m are 36 steps."""
    lay()
    found = day("SeekCharger", short(chargers=[[150, 170], [100, 150]]))
    assert found.statuses[:37] == ["RUNNING"] * 36 + ["SUCCESS"]


def test_charge_only_at_a_charger(lay: Lay) -> None:
    """Away from a charger ExecuteCharge fails; 2 m are near enough."""
    lay()
    for x, status in ((152, "RUNNING"), (152.01, "FAILURE")):
        assert day("ExecuteCharge", short(1, chargers=[[x, 150]])).statuses[0] == status


@pytest.mark.parametrize(
    ("battery", "status"), [(94.99, "RUNNING"), (95, "FAILURE"), (100, "FAILURE")]
)
def test_charge_only_below_95(lay: Lay, battery: float, status: str) -> None:
    """From 95 % on ExecuteCharge fails and counts for nothing."""
    lay()
    calm = {"battery_start": battery, "drain_standing": 0}
    found = day("ExecuteCharge", short(1, chargers=[[150, 150]], robot=calm))
    assert found.statuses[0] == status
    assert len(found.amounts(IslandEvent.CHARGE)) == (status == "RUNNING")


def test_charge_to_the_full(lay: Lay) -> None:
    """It charges 5 % a second up to 100 %, past 95 %, then succeeds; that is one attempt."""
    lay()
    found = day("ExecuteCharge", short(chargers=[[150, 150]], robot={"battery_start": 80}))
    assert found.statuses[:41] == ["RUNNING"] * 40 + ["SUCCESS"]
    assert [found.moments[i].battery for i in (0, 10, 40)] == [80, 85, 100]
    assert found.amounts(IslandEvent.CHARGE) == [80]


def test_charging_counts_again_after_use(lay: Lay) -> None:
    """Another attempt counts only when 10 % of charge were used up since the last that did."""
    lay()
    hungry = {"battery_start": 59, "drain_standing": 10, "charge_rate": 5}  # %/s
    found = day(
        "selector { when batteryLevel < 60 { ExecuteCharge } PickupGarbage }",
        short(60, chargers=[[150, 150]], robot=hungry),
    )
    steps = found.steps(IslandEvent.CHARGE)
    sessions = sum(
        before != "RUNNING" == now
        for before, now in zip(["", *found.statuses], found.statuses, strict=False)
    )
    assert 3 <= len(steps) < sessions / 3
    batteries = [moment.battery for moment in found.moments]
    used = [max(0.0, a - b) for a, b in pairwise(batteries)]
    for one, two in pairwise(steps):
        assert sum(used[one:two]) >= 10 - 1e-9


def test_charging_is_no_idleness(lay: Lay) -> None:
    """Who charges acts, and its last action is now."""
    lay()
    found = day(
        "ExecuteCharge",
        short(15, chargers=[[150, 150]], robot={"battery_start": 5}),
    )
    assert found.counts() == {"CHARGE": 1}
    assert found.episode.inactive == pytest.approx(0, abs=0.11)


# MoveToHumanoid


def test_move_to_humanoid(lay: Lay) -> None:
    """It drives to the humanoid until it is within 2 m, and takes over what it carries."""
    lay(humanoids=[(160, 150)], turns=asking(0))
    found = day("MoveToHumanoid", short())
    assert found.statuses[:5] == ["FAILURE"] * 5, "nobody asks before the fifth item"
    first = found.statuses.index("SUCCESS")
    assert found.amounts(IslandEvent.INTERACTION) == [5]
    assert found.steps(IslandEvent.INTERACTION) == [first]
    assert found.moments[first].x == pytest.approx(158, abs=0.51)
    assert found.moments[first].load == 5
    assert found.statuses[first + 1] == "FAILURE", "a humanoid that was cleared asks no more"


@pytest.mark.parametrize(("x", "seen"), [(165, True), (165.01, False)])
def test_humanoid_in_sight(lay: Lay, x: float, seen: bool) -> None:
    """Who asks is seen up to 15 m, that included."""
    lay(humanoids=[(x, 150)], turns=asking(0))
    late = day("MoveToHumanoid", short(1)).moments[6]
    assert late.board[ASKED] == seen
    assert late.status == ("RUNNING" if seen else "FAILURE")


def test_full_robot_takes_nothing_over(lay: Lay) -> None:
    """Without room MoveToHumanoid fails; with little room it takes what fits."""
    lay(humanoids=[(151.5, 150)], turns=asking(0, items=9))
    found = day("MoveToHumanoid", short(2, robot={"capacity": 3}))
    assert found.amounts(IslandEvent.INTERACTION) == [3]
    assert found.moments[-1].load == 3
    assert found.statuses[-1] == "FAILURE"


def test_a_humanoid_with_enough_left_asks_on(lay: Lay) -> None:
    """Who still carries five asks again at once."""
    lay(humanoids=[(151.5, 150)], turns=asking(0, items=10))
    island = short(6, robot={"capacity": 4}, waypoints=[[150, 160], [150, 162]])
    found = day("sequence { PatrolWaypoint MoveToHumanoid }", island)
    (first,) = found.steps(IslandEvent.INTERACTION)
    assert found.amounts(IslandEvent.INTERACTION) == [4]
    assert found.moments[first + 1].carried == (6,)
    assert found.moments[first + 1].board[ASKED] == 1


def test_moving_humanoids_are_caught(lay: Lay) -> None:
    """A humanoid that walks away at 1.2 m/s is caught by a robot at 5 m/s."""
    turns = [*asking(0), *((step, 0, 1.2, 0.0) for step in range(6, 100))]
    lay(humanoids=[(160, 150)], turns=turns)
    found = day("MoveToHumanoid", short())
    assert found.amounts(IslandEvent.INTERACTION)[0] >= 5
    assert found.steps(IslandEvent.INTERACTION)[0] < 40


# DeliverToClearingPoint


def test_delivery(lay: Lay) -> None:
    """It drives to the nearest clearing point and unloads everything."""
    lay(garbage=[150 + 150j, 150 + 151j])
    tree = "selector { PickupGarbage DeliverToClearingPoint }"
    found = day(tree, short(clearing_points=[[170, 150], [100, 150]]))
    arrival = 2 + 36  # two pickups, then 18 m
    assert found.steps(IslandEvent.DELIVERY) == [arrival]
    assert found.amounts(IslandEvent.DELIVERY) == [2]
    assert found.statuses[arrival] == "SUCCESS"
    assert found.moments[arrival].load == 0


def test_empty_delivery_costs_once_a_visit(lay: Lay) -> None:
    """An empty robot that stays at the clearing point pays once, however often it tries."""
    lay()
    found = day("DeliverToClearingPoint", short(clearing_points=[[150, 150]]))
    assert set(found.statuses) == {"FAILURE"}
    assert found.steps(IslandEvent.EMPTY_DELIVERY) == [0]


def test_empty_delivery_costs_again_after_leaving(lay: Lay) -> None:
    """Who leaves the clearing point and comes back pays again."""
    lay()
    tree = "sequence { inverter { DeliverToClearingPoint } PatrolWaypoint }"
    island = short(20, clearing_points=[[150, 150]], waypoints=[[150, 160], [150, 161]])
    found = day(tree, island)
    near = [abs(moment.y - 150) <= 2 for moment in found.moments]
    visits = sum(now and not before for before, now in zip([False, *near], near, strict=False))
    assert len(found.steps(IslandEvent.EMPTY_DELIVERY)) == visits >= 4


def test_delivery_clears_the_way_for_another_fine(lay: Lay) -> None:
    """A robot that has delivered and stays is empty, and pays once for trying again."""
    lay(garbage=[150 + 150j])
    tree = "selector { PickupGarbage DeliverToClearingPoint }"
    found = day(tree, short(0.9, clearing_points=[[150, 150]]))
    assert found.counts() == {"PICKUP": 1, "DELIVERY": 1, "EMPTY_DELIVERY": 1}


# PatrolWaypoint


def test_patrol(lay: Lay) -> None:
    """It drives from waypoint to waypoint and succeeds at each; the last one ends a lap."""
    lay()
    island = short(20, waypoints=[[150, 160], [160, 160], [160, 150]])
    found = day("PatrolWaypoint", island)
    arrivals = [moment for moment in found.moments if moment.status == "SUCCESS"]
    assert [(m.x, m.y) for m in arrivals[:1]] == [(pytest.approx(150), pytest.approx(158))]
    laps = [moment.board[2] for moment in arrivals]
    assert laps[:7] == [0, 0, 0, 1, 1, 1, 2], "the lap is on the blackboard at the next tick"
    assert found.episode.laps == len(arrivals) // 3


def test_discovery_on_patrol(lay: Lay) -> None:
    """On patrol each new thing counts once, and each 20 m with a discovery once."""
    lay(garbage=[150 + 170j, 151 + 170j, 150 + 190j], humanoids=[(140, 170)])
    found = day("PatrolWaypoint", short(9, waypoints=[[150, 200], [150, 210]]))
    assert sum(found.amounts(IslandEvent.DISCOVERY)) == 4
    # Seen 15 m before: at 5 m the two items and the humanoid, then at 25 m the third item.
    assert len(found.amounts(IslandEvent.PATROL)) == 2
    assert found.steps(IslandEvent.PATROL)[0] == pytest.approx(10, abs=2)
    assert found.steps(IslandEvent.PATROL)[1] == pytest.approx(50, abs=2)


def test_no_discovery_without_patrol(lay: Lay) -> None:
    """Who drives for another reason finds nothing that counts, not even later on patrol."""
    lay(garbage=[150 + 170j])
    assert day("SeekCharger", short(7, chargers=[[150, 190]])).counts() == {}
    tree = "sequence { SeekCharger PatrolWaypoint }"
    found = day(tree, short(20, chargers=[[150, 190]], waypoints=[[150, 160], [150, 170]]))
    assert found.counts() == {}


# Idleness


def test_idle_seconds(lay: Lay) -> None:
    """Who neither drives nor acts is told each second of it; the first twenty cost nothing."""
    lay()
    found = day("PickupGarbage", short(30))
    assert found.amounts(IslandEvent.IDLE) == list(range(1, 31))
    assert found.steps(IslandEvent.IDLE) == list(range(10, 301, 10))
    assert found.episode.fitness == -10 * 10


def test_an_action_ends_idleness(lay: Lay) -> None:
    """A pickup in between lets the count begin again, and so does driving."""
    lay(spawns=[(35, 150.0, 150.0)])
    found = day("PickupGarbage", short(6))
    assert found.steps(IslandEvent.PICKUP) == [35]
    assert found.amounts(IslandEvent.IDLE) == [1, 2, 3, 1, 2]
    lay(spawns=[(35, 155.0, 150.0)])
    assert day("MoveToGarbage", short(6)).amounts(IslandEvent.IDLE) == [1, 2, 3, 1]


def test_driving_is_no_idleness(lay: Lay) -> None:
    """A robot on its way is never idle."""
    lay()
    assert day("PatrolWaypoint", short(30)).counts() == {}


def test_inactive_time(lay: Lay) -> None:
    """The time since the last non-movement action; driving does not shorten it."""
    lay(spawns=[(40, 150.0, 150.0)])
    found = day("PickupGarbage", short(10))
    assert found.episode.inactive == pytest.approx(6, abs=0.11)
    assert day("PatrolWaypoint", short(10)).episode.inactive == 10
