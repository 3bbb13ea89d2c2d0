"""When an episode ends (section 2.2.2): each ending by a tree that is made for it."""

from __future__ import annotations

import pytest

from islandgp.bt.core.language import parse
from islandgp.domains.island.world import IslandWorld
from tests.domains.island.conftest import Lay
from tests.domains.island.days import Episode, day, points, run_episode, world

PATROL, STANDING = "PatrolWaypoint", "PickupGarbage"


def run(tree: str, island: IslandWorld) -> Episode:
    """The episode as a run has it, steps skipped and all."""
    return run_episode(parse(tree), island, 0, points())


def test_time(lay: Lay) -> None:
    """An episode that goes well lasts 420 s."""
    spawns = [(step, 150.0, 150.0) for step in range(500, 4200, 500)]
    lay(spawns=spawns)
    episode = run(STANDING, world(robot={"drain_standing": 0.01}))
    assert (episode.ending, episode.steps) == ("time", 4200)


@pytest.mark.parametrize(
    ("battery", "seconds"),
    [
        (70, 120),  # 46 % are left after 120 s of driving at 0.2 %/s
        (64, 120),  # 40 % are left: not low
        (63.9, 180),  # 39.9 %: low
        (50, 180),
    ],
)
def test_stagnation(lay: Lay, battery: float, seconds: int) -> None:
    """No better fitness for 120 s ends it; for 180 s while the battery is below 40 %."""
    lay()
    far = [[150, 150 + side * 140] for side in (1, -1)]  # it stands for a tick at each arrival
    slow = {"battery_start": battery, "speed": 1.2}
    episode = run(PATROL, world(robot=slow, waypoints=far))
    assert (episode.ending, episode.steps) == ("stagnation", seconds * 10)


def test_stagnation_counts_from_the_best(lay: Lay) -> None:
    """The clock starts again with each better fitness, and not with one that only recovers."""
    lay(spawns=[(300, 150.0, 150.0)])
    episode = run(STANDING, world(robot={"drain_standing": 0.01}))
    assert (episode.ending, episode.steps) == ("stagnation", 300 + 1200)


def test_charging_above_40_shortens_the_patience_again(lay: Lay) -> None:
    """What counts is the battery now: charged in time, an old plateau is 120 s again."""
    lay()
    low = {"battery_start": 20, "charge_rate": 0.1, "drain_moving": 0.0}  # 40 % after 200 s
    episode = run(PATROL, world(robot=low))
    assert episode.steps == 1800
    charging = {"battery_start": 25, "charge_rate": 0.1}  # 40 % after 150 s
    episode = run("ExecuteCharge", world(robot=charging, chargers=[[150, 150]]))
    assert (episode.ending, episode.steps) == ("stagnation", 1500)


def test_negative(lay: Lay) -> None:
    """Idleness costs from second 21 on: fitness is negative, and 60 s later it is over."""
    lay()
    episode = run(STANDING, world())
    assert (episode.ending, episode.steps) == ("negative", 210 + 600)
    assert episode.fitness == -10 * 61


def test_negative_ends_with_a_gain(lay: Lay) -> None:
    """A gain that brings the fitness back above 0 stops that clock."""
    lay(spawns=[(800, 150.0, 150.0)])
    episode = run(STANDING, world(robot={"drain_standing": 0.01}))
    # -10 a second from 21 to 80 are -600; the pickup adds 600. That is 0, neither negative nor
    # a better best. The next idle second, one after 20 more, makes it negative again.
    assert (episode.ending, episode.steps) == ("stagnation", 1200)


def test_shutdown(lay: Lay) -> None:
    """An empty battery ends it, and costs: 70 % last 350 s of driving."""
    garbage = [complex(150, y) for y in range(20, 290, 10)]
    lay(garbage=garbage, spawns=[(s, 150.0, 40.0 + s % 200) for s in range(100, 4000, 100)])
    trace = day(PATROL, world(waypoints=[[150, 30], [150, 270]]))
    arrivals = trace.statuses.count("SUCCESS")  # at each it stands for a tick, at a quarter
    steps = 3500 + round(arrivals * 0.75)
    assert trace.episode.ending == "shutdown"
    assert trace.episode.steps == pytest.approx(steps, abs=1)
    assert (trace.amounts("shutdown"), trace.steps("shutdown")) == (
        [1],
        [trace.episode.steps],
    )
    assert trace.episode.battery == 0


def test_leftover_is_counted_at_the_end(lay: Lay) -> None:
    """Each episode's last event is the garbage that still lies there."""
    lay(garbage=[150 + 150j, 10 + 10j, 20 + 20j], spawns=[(5, 280.0, 280.0)])
    trace = day(STANDING, world(episode={"length": 2}))
    assert trace.episode.events[-1] == (20, "leftover", 3)
    assert trace.amounts("leftover") == [3]


def test_fitness_is_the_sum_of_the_events(lay: Lay) -> None:
    """The running account that ends episodes is the account that scores them."""
    lay(garbage=[150 + 150j, 160 + 150j], humanoids=[(150, 158)])
    award = points(2)
    trace = day("selector { PickupGarbage MoveToGarbage PatrolWaypoint }", world(), stage=2)
    total = sum(award(event, amount)[1] for _, event, amount in trace.episode.events)
    assert trace.episode.fitness == pytest.approx(total)
