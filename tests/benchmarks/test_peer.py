"""The peer of the benchmarks lives through the same days as ours does."""

from __future__ import annotations

from collections import Counter
from importlib.util import find_spec

import pytest

from benchmarks.pinned import endless, example, points, settings
from islandgp.domains.island.episode import run_episode

pytestmark = pytest.mark.skipif(
    not (find_spec("py_trees") and find_spec("deap")), reason="extra `bench` is not installed"
)

WORK = (
    "pickup",
    "interaction",
    "delivery",
    "charge",
    "empty_delivery",
)


@pytest.mark.slow
@pytest.mark.parametrize("tree", ["all_rounder", "multi_behaviour", "poor"])
def test_the_peer_does_the_same_work(tree: str) -> None:
    """What a robot achieves in a day differs by less than five in a hundred."""
    from benchmarks.peer.episode import run_peer_episode

    world, ours, theirs = settings().world, Counter[str](), Counter[str]()
    for seed in range(4):
        episode = run_episode(example(tree), world, seed, points())
        peer = run_peer_episode(example(tree), world, seed, points())
        ours.update(event for _, event, _ in episode.event_log.events)
        theirs.update(peer.counts)
        assert peer.steps == pytest.approx(episode.step, rel=0.05)
    for event in WORK:
        assert theirs[event] == pytest.approx(ours[event], rel=0.05, abs=1), event.name
    assert sum(theirs[event] for event in WORK) > 10


@pytest.mark.slow
def test_the_peer_charges() -> None:
    """A robot that starts with an empty battery charges as often as ours."""
    from benchmarks.peer.episode import run_peer_episode

    world = endless(settings().world, robot={"battery_start": 30, "drain_moving": 0.5})
    episode = run_episode(example("all_rounder"), world, 1, points())
    charges = sum(event == "charge" for _, event, _ in episode.event_log.events)
    peer = run_peer_episode(example("all_rounder"), world, 1, points())
    assert charges >= 2
    assert peer.counts["charge"] == charges


@pytest.mark.slow
@pytest.mark.process
def test_deap_gives_each_individual_its_fitness() -> None:
    """A batch through DEAP's toolbox comes back in order, with the fitness of each episode."""
    from benchmarks.peer import batch
    from benchmarks.peer.episode import run_peer_episode
    from islandgp.bt.core.language import to_text

    world = endless(settings().world, episode={"length": 20})
    trees = [example("all_rounder"), example("poor")]
    jobs = [(to_text(tree), seed) for tree in trees for seed in range(2)]
    batch.start(world)
    with batch.pool(1, world) as workers:
        fitnesses = batch.run_batch(batch.toolbox(workers), jobs)
    singles = [run_peer_episode(t, world, s, points()).fitness for t in trees for s in range(2)]
    assert fitnesses == singles
    assert len(set(fitnesses)) > 1
