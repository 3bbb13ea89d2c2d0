"""The seven actions: when each runs, succeeds and fails, and what it writes down."""

from __future__ import annotations

from itertools import pairwise

import pytest

from islandgp.domains.island.world import IslandWorld
from tests.domains.island.conftest import Lay
from tests.domains.island.days import day, world

GARBAGE_KEY, HUMANOID_KEY = 3, 4  # places on the blackboard


def short(seconds: float = 10, **changes: object) -> IslandWorld:
    """Short episodes; the robot starts at (150, 150) and drives 0.5 m a step."""
    return world(episode={"length": seconds}, **changes)


def asking(*people: int, items: int = 5, first: int = 1) -> list[tuple[int, int, float, float]]:
    """Cues after which humanoids carry so many items; one is found at each step."""
    return [(first + n, h, 0.0, 0.0) for n in range(items) for h in people]


# MoveToGarbage


def test_move_to_garbage_arrives(lay: Lay) -> None:
    """It drives until the item is within 1.5 m: 8.5 of 10 m are 17 steps."""
    lay(garbage=[160 + 150j])
    trace = day("MoveToGarbage", short())
    assert trace.statuses[:18] == ["RUNNING"] * 17 + ["SUCCESS"]
    assert trace.moments[17].x == pytest.approx(158.5)


@pytest.mark.parametrize(
    ("x", "visible"), [(164.9, True), (165, True), (165.01, False), (200, False)]
)
def test_garbage_in_sight(lay: Lay, x: float, visible: bool) -> None:
    """Perception reaches 15 m, that included; beyond it MoveToGarbage fails."""
    lay(garbage=[complex(x, 150)])
    first = day("MoveToGarbage", short()).moments[0]
    assert first.board[GARBAGE_KEY] == visible
    assert first.status == ("RUNNING" if visible else "FAILURE")


def test_move_to_garbage_takes_the_nearest(lay: Lay) -> None:
    """Of several items it drives to the nearest, and keeps to it."""
    lay(garbage=[150 + 162j, 159 + 150j, 150 + 139j], spawns=[(3, 150.0, 153.0)])
    trace = day("MoveToGarbage", short())
    arrival = trace.moments[trace.statuses.index("SUCCESS")]
    assert (arrival.x, arrival.y) == (pytest.approx(157.5), pytest.approx(150))


# PickupGarbage


@pytest.mark.parametrize(("x", "reached"), [(150, True), (151.5, True), (151.51, False)])
def test_pickup_reach(lay: Lay, x: float, reached: bool) -> None:
    """It takes an item within 1.5 m at once, and nothing farther away."""
    lay(garbage=[complex(x, 150)])
    trace = day("PickupGarbage", short(1))
    assert trace.statuses[0] == ("SUCCESS" if reached else "FAILURE")
    assert trace.amounts("pickup") == [1] * reached
    assert trace.amounts("leftover") == [1 - reached]


def test_one_item_is_picked_up_once(lay: Lay) -> None:
    """Twice in a tick can't take the same item."""
    lay(garbage=[150.5 + 150j])
    trace = day("sequence { PickupGarbage PickupGarbage }", short(1))
    assert trace.statuses[0] == "FAILURE"
    assert (trace.amounts("pickup"), trace.moments[-1].load) == ([1], 1)


def test_two_items_in_a_tick(lay: Lay) -> None:
    """Two items in reach can be taken in one tick, each once."""
    lay(garbage=[150.5 + 150j, 149.5 + 150j])
    trace = day("parallel { PickupGarbage PickupGarbage }", short(1))
    assert trace.statuses[:2] == ["SUCCESS", "FAILURE"]
    assert trace.steps("pickup") == [0, 0]


def test_a_full_robot_cannot_pick_up(lay: Lay) -> None:
    """Without room PickupGarbage fails, and the item stays."""
    lay(garbage=[150.5 + 150j, 149.5 + 150j, 150 + 150.5j])
    trace = day("PickupGarbage", short(1, robot={"capacity": 2}))
    assert trace.statuses[:4] == ["SUCCESS", "SUCCESS", "FAILURE", "FAILURE"]
    assert [moment.board[1] for moment in trace.moments[:4]] == [2, 1, 0, 0]
    assert trace.moments[-1].lying == 1


# SeekCharger, ExecuteCharge


def test_seek_charger(lay: Lay) -> None:
    """It drives to the nearest charger until it is within 2 m: 18 of 20 m are 36 steps."""
    lay()
    trace = day("SeekCharger", short(chargers=[[150, 170], [100, 150]]))
    assert trace.statuses[:37] == ["RUNNING"] * 36 + ["SUCCESS"]


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
    trace = day("ExecuteCharge", short(1, chargers=[[150, 150]], robot=calm))
    assert trace.statuses[0] == status
    assert len(trace.amounts("charge")) == (status == "RUNNING")


def test_charge_to_the_full(lay: Lay) -> None:
    """It charges 5 % a second up to 100 %, past 95 %, then succeeds; that is one attempt."""
    lay()
    trace = day("ExecuteCharge", short(chargers=[[150, 150]], robot={"battery_start": 80}))
    assert trace.statuses[:41] == ["RUNNING"] * 40 + ["SUCCESS"]
    assert [trace.moments[i].battery for i in (0, 10, 40)] == [80, 85, 100]
    assert trace.amounts("charge") == [80]


def test_charging_counts_again_after_use(lay: Lay) -> None:
    """Another attempt counts only when 10 % of charge were used up since the last that did."""
    lay()
    hungry = {"battery_start": 59, "drain_standing": 10, "charge_rate": 5}  # %/s
    trace = day(
        "selector { when batteryLevel < 60 { ExecuteCharge } PickupGarbage }",
        short(60, chargers=[[150, 150]], robot=hungry),
    )
    steps = trace.steps("charge")
    sessions = sum(
        before != "RUNNING" == now
        for before, now in zip(["", *trace.statuses], trace.statuses, strict=False)
    )
    assert 3 <= len(steps) < sessions / 3
    batteries = [moment.battery for moment in trace.moments]
    drops = [max(0.0, a - b) for a, b in pairwise(batteries)]
    for one, two in pairwise(steps):
        assert sum(drops[one:two]) >= 10 - 1e-9


def test_charging_is_no_idleness(lay: Lay) -> None:
    """Who charges acts, and its last action is now."""
    lay()
    trace = day(
        "ExecuteCharge",
        short(15, chargers=[[150, 150]], robot={"battery_start": 5}),
    )
    assert trace.counts() == {"CHARGE": 1}
    assert trace.episode.inactive == pytest.approx(0, abs=0.11)


# MoveToHumanoid


def test_move_to_humanoid(lay: Lay) -> None:
    """It drives to the humanoid until it is within 2 m, and takes over what it carries."""
    lay(humanoids=[(160, 150)], turns=asking(0))
    trace = day("MoveToHumanoid", short())
    assert trace.statuses[:5] == ["FAILURE"] * 5, "nobody asks before the fifth item"
    first = trace.statuses.index("SUCCESS")
    assert trace.amounts("interaction") == [5]
    assert trace.steps("interaction") == [first]
    assert trace.moments[first].x == pytest.approx(158, abs=0.51)
    assert trace.moments[first].load == 5
    assert trace.statuses[first + 1] == "FAILURE", "a humanoid that was cleared asks no more"


@pytest.mark.parametrize(("x", "visible"), [(165, True), (165.01, False)])
def test_humanoid_in_sight(lay: Lay, x: float, visible: bool) -> None:
    """Who asks is seen up to 15 m, that included."""
    lay(humanoids=[(x, 150)], turns=asking(0))
    late = day("MoveToHumanoid", short(1)).moments[6]
    assert late.board[HUMANOID_KEY] == visible
    assert late.status == ("RUNNING" if visible else "FAILURE")


def test_a_full_robot_cannot_take_garbage_over(lay: Lay) -> None:
    """Without room MoveToHumanoid fails; with little room it takes what fits."""
    lay(humanoids=[(151.5, 150)], turns=asking(0, items=9))
    trace = day("MoveToHumanoid", short(2, robot={"capacity": 3}))
    assert trace.amounts("interaction") == [3]
    assert trace.moments[-1].load == 3
    assert trace.statuses[-1] == "FAILURE"


def test_a_humanoid_with_enough_left_asks_on(lay: Lay) -> None:
    """Who still carries five asks again at once."""
    lay(humanoids=[(151.5, 150)], turns=asking(0, items=10))
    island = short(6, robot={"capacity": 4}, waypoints=[[150, 160], [150, 162]])
    trace = day("sequence { PatrolWaypoint MoveToHumanoid }", island)
    (first,) = trace.steps("interaction")
    assert trace.amounts("interaction") == [4]
    assert trace.moments[first + 1].carried == (6,)
    assert trace.moments[first + 1].board[HUMANOID_KEY] == 1


def test_moving_humanoids_are_caught(lay: Lay) -> None:
    """A humanoid that walks away at 1.2 m/s is caught by a robot at 5 m/s."""
    turns = [*asking(0), *((step, 0, 1.2, 0.0) for step in range(6, 100))]
    lay(humanoids=[(160, 150)], turns=turns)
    trace = day("MoveToHumanoid", short())
    assert trace.amounts("interaction")[0] >= 5
    assert trace.steps("interaction")[0] < 40


# DeliverToClearingPoint


def test_delivery(lay: Lay) -> None:
    """It drives to the nearest clearing point and unloads everything."""
    lay(garbage=[150 + 150j, 150 + 151j])
    tree = "selector { PickupGarbage DeliverToClearingPoint }"
    trace = day(tree, short(clearing_points=[[170, 150], [100, 150]]))
    arrival = 2 + 36  # two pickups, then 18 m
    assert trace.steps("delivery") == [arrival]
    assert trace.amounts("delivery") == [2]
    assert trace.statuses[arrival] == "SUCCESS"
    assert trace.moments[arrival].load == 0


def test_empty_delivery_costs_once_a_visit(lay: Lay) -> None:
    """An empty robot that stays at the clearing point pays once, however often it tries."""
    lay()
    trace = day("DeliverToClearingPoint", short(clearing_points=[[150, 150]]))
    assert set(trace.statuses) == {"FAILURE"}
    assert trace.steps("empty_delivery") == [0]


def test_empty_delivery_costs_again_after_leaving(lay: Lay) -> None:
    """Who leaves the clearing point and comes back pays again."""
    lay()
    tree = "sequence { inverter { DeliverToClearingPoint } PatrolWaypoint }"
    island = short(20, clearing_points=[[150, 150]], waypoints=[[150, 160], [150, 161]])
    trace = day(tree, island)
    near = [abs(moment.y - 150) <= 2 for moment in trace.moments]
    visits = sum(now and not before for before, now in zip([False, *near], near, strict=False))
    assert len(trace.steps("empty_delivery")) == visits >= 4


def test_delivery_clears_the_way_for_another_fine(lay: Lay) -> None:
    """A robot that has delivered and stays is empty, and pays once for trying again."""
    lay(garbage=[150 + 150j])
    tree = "selector { PickupGarbage DeliverToClearingPoint }"
    trace = day(tree, short(0.9, clearing_points=[[150, 150]]))
    assert trace.counts() == {"PICKUP": 1, "DELIVERY": 1, "EMPTY_DELIVERY": 1}


# PatrolWaypoint


def test_patrol(lay: Lay) -> None:
    """It drives from waypoint to waypoint and succeeds at each; the last one ends a lap."""
    lay()
    island = short(20, waypoints=[[150, 160], [160, 160], [160, 150]])
    trace = day("PatrolWaypoint", island)
    arrivals = [moment for moment in trace.moments if moment.status == "SUCCESS"]
    assert [(m.x, m.y) for m in arrivals[:1]] == [(pytest.approx(150), pytest.approx(158))]
    laps = [moment.board[2] for moment in arrivals]
    assert laps[:7] == [0, 0, 0, 1, 1, 1, 2], "the lap is on the blackboard at the next tick"
    assert trace.episode.laps == len(arrivals) // 3


def test_discovery_on_patrol(lay: Lay) -> None:
    """On patrol each new thing counts once, and each 20 m with a discovery once."""
    lay(garbage=[150 + 170j, 151 + 170j, 150 + 190j], humanoids=[(140, 170)])
    trace = day("PatrolWaypoint", short(9, waypoints=[[150, 200], [150, 210]]))
    assert sum(trace.amounts("discovery")) == 4
    # Seen 15 m before: at 5 m the two items and the humanoid, then at 25 m the third item.
    assert len(trace.amounts("patrol")) == 2
    assert trace.steps("patrol")[0] == pytest.approx(10, abs=2)
    assert trace.steps("patrol")[1] == pytest.approx(50, abs=2)


def test_no_discovery_without_patrol(lay: Lay) -> None:
    """Who drives for another reason finds nothing that counts, not even later on patrol."""
    lay(garbage=[150 + 170j])
    assert day("SeekCharger", short(7, chargers=[[150, 190]])).counts() == {}
    tree = "sequence { SeekCharger PatrolWaypoint }"
    trace = day(tree, short(20, chargers=[[150, 190]], waypoints=[[150, 160], [150, 170]]))
    assert trace.counts() == {}


# Idleness


def test_idle_seconds(lay: Lay) -> None:
    """Each second without driving or acting is an event; the first twenty cost nothing."""
    lay()
    trace = day("PickupGarbage", short(30))
    assert trace.amounts("idle") == list(range(1, 31))
    assert trace.steps("idle") == list(range(10, 301, 10))
    assert trace.episode.fitness == -10 * 10


def test_an_action_ends_idleness(lay: Lay) -> None:
    """A pickup in between lets the count begin again, and so does driving."""
    lay(spawns=[(35, 150.0, 150.0)])
    trace = day("PickupGarbage", short(6))
    assert trace.steps("pickup") == [35]
    assert trace.amounts("idle") == [1, 2, 3, 1, 2]
    lay(spawns=[(35, 155.0, 150.0)])
    assert day("MoveToGarbage", short(6)).amounts("idle") == [1, 2, 3, 1]


def test_driving_is_no_idleness(lay: Lay) -> None:
    """A robot on its way is never idle."""
    lay()
    assert day("PatrolWaypoint", short(30)).counts() == {}


def test_inactive_time(lay: Lay) -> None:
    """The time since the last non-movement action; driving does not shorten it."""
    lay(spawns=[(40, 150.0, 150.0)])
    trace = day("PickupGarbage", short(10))
    assert trace.episode.inactive == pytest.approx(6, abs=0.11)
    assert day("PatrolWaypoint", short(10)).episode.inactive == 10
