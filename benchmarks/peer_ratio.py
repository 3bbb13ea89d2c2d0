"""A generation's evaluation with the usual parts, over the same with ours."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from time import perf_counter, process_time
from typing import Final

from benchmarks.figure import Effort, Figure, Missing, at_least
from benchmarks.pinned import STAGE, example, points, setting, settings
from benchmarks.turns import medians, ratio, turns
from islandgp.bt.core.language import to_text
from islandgp.domains.island.episode import run_episode
from islandgp.domains.island.world import IslandWorld
from islandgp.evaluation.base import Job, Problem
from islandgp.evaluation.processes import Processes, cores

TREES: Final = (  # of grammar/examples
    "all_rounder",
    "charging_focused",
    "clearing_focused",
    "diverse",
    "humanoid_focused",
    "multi_behaviour",
    "paper_fig9",
    "pickup_specialist",
    "poor",
    "rare_category",
)
SEEDS: Final = {Effort.TINY: 1, Effort.QUICK: 3, Effort.FULL: 3}  # times TREES: 30 episodes
ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 2, Effort.FULL: 3}
SINGLE: Final = {Effort.TINY: 1, Effort.QUICK: 3, Effort.FULL: 6}  # seeds of the all-rounder
MOST_WORKERS: Final = 4


def measure(effort: Effort) -> list[Figure]:
    """A batch through both evaluators in turns, then single episodes of the all-rounder."""
    for part in ("py_trees", "deap"):
        if find_spec(part) is None:
            raise Missing(f"{part} is not installed; pip install 'islandgp[bench]'")
    short = ("world.episode.length=10",) if effort is Effort.TINY else ()
    workers = min(MOST_WORKERS, cores())
    batch = _batches(effort, setting(*short), settings(*short).world, workers)
    single, alike = _singles(effort, settings(*short).world)
    peer_s, our_s = medians(batch)
    peer_ms, our_ms = (1000 * seconds for seconds in medians(single))
    episodes = SEEDS[effort] * len(TREES)
    return [
        Figure(
            "peer_ratio",
            ratio(batch, 0, 1),
            "",
            f"{episodes} episodes with the usual parts / with ours, {workers} workers each",
            at_least(35.0),
        ),
        Figure("peer_batch_s", peer_s, "s", "the usual parts"),
        Figure("our_batch_s", our_s, "s", "ours"),
        Figure("single_ratio", ratio(single, 0, 1), "", "one all-rounder's episode, no processes"),
        Figure("peer_episode_ms", peer_ms, "ms", "the usual parts"),
        Figure("our_episode_ms", our_ms, "ms", "ours"),
        *alike,
    ]


def _batches(
    effort: Effort, setting: Problem, world: IslandWorld, workers: int
) -> list[tuple[float, ...]]:
    """Rows of seconds: the peer's pool, our pool; both have been warmed up."""
    from benchmarks.peer import batch

    texts = [to_text(example(name)) for name in TREES]
    jobs = [(text, seed) for seed in range(SEEDS[effort]) for text in texts]
    ours = Processes(setting, workers)
    theirs = batch.pool(workers, world)
    try:
        box = batch.toolbox(theirs)
        sides: Sequence[Callable[[], object]] = (
            partial(batch.run_batch, box, jobs),
            partial(ours.evaluate, [Job(text, STAGE, seed) for text, seed in jobs]),
        )
        for side in sides:
            side()
        return turns(sides, ROUNDS[effort], clock=perf_counter)
    finally:
        ours.close()
        theirs.close()
        theirs.join()


def _singles(effort: Effort, world: IslandWorld) -> tuple[list[tuple[float, ...]], list[Figure]]:
    """Rows of CPU seconds, the peer's first; and figures that show that both do the same work."""
    from benchmarks.peer.episode import run_peer_episode

    tree, award = example("all_rounder"), points()
    rows: list[tuple[float, ...]] = []
    theirs, ours = [0, 0], [0, 0]  # pickups, deliveries
    for seed in range(SINGLE[effort]):
        peer = run_peer_episode(tree, world, seed, award)
        kinds = [event for _, event, _ in run_episode(tree, world, seed, award).event_log.events]
        for i, event in enumerate(("pickup", "delivery")):
            theirs[i] += peer.counts.get(event, 0)
            ours[i] += kinds.count(event)
        sides = [partial(run, tree, world, seed, award) for run in (run_peer_episode, run_episode)]
        rows += turns(sides, 1, clock=process_time)
    return rows, [
        Figure(f"peer_{name}", _share(a, b), "%", f"the usual parts' {name}, in percent of ours")
        for name, a, b in zip(("pickups", "deliveries"), theirs, ours, strict=True)
    ]


def _share(theirs: int, ours: int) -> float:
    return 100 * theirs / ours if ours else 100.0 * (theirs == ours)
