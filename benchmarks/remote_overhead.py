"""Episodes on a Ray cluster of two nodes on this machine, over the same episodes in processes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from time import perf_counter
from typing import Final

from benchmarks.figure import Effort, Figure, Missing, at_most
from benchmarks.pinned import STAGE, example, setting
from benchmarks.turns import medians, ratio, turns
from islandgp.bt.core.language import to_text
from islandgp.evaluation.base import Job
from islandgp.evaluation.processes import Processes
from islandgp_ray.evaluator import Ray

NODES: Final = 2  # of one core each
EPISODES: Final = {Effort.TINY: 4, Effort.QUICK: 60, Effort.FULL: 120}  # of a batch
ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 2, Effort.FULL: 4}


def measure(effort: Effort) -> list[Figure]:
    """Batches of the all-rounder's episodes on the cluster and in processes, in turns."""
    if find_spec("ray") is None:
        raise Missing("ray is not installed; pip install ./plugins/ray")
    problem = setting(*(("world.episode.length=5",) if effort is Effort.TINY else ()))
    tree = to_text(example("all_rounder"))
    jobs = [Job(tree, STAGE, seed) for seed in range(EPISODES[effort])]
    processes = Processes(problem, NODES)
    try:
        with _cluster() as address:
            cluster = Ray(Ray.Settings(address=address, cpus=1, retries=0, workers=0), problem)
            try:
                sides = [partial(each.evaluate, jobs) for each in (cluster, processes)]
                for side in [*sides, *sides]:  # workers start
                    side()
                rows = turns(sides, ROUNDS[effort], clock=perf_counter)
            finally:
                cluster.close()
    finally:
        processes.close()
    remote_s, local_s = medians(rows)
    return [
        Figure(
            "remote_overhead",
            100 * (ratio(rows, 0, 1) - 1),
            "%",
            f"{len(jobs)} episodes on a Ray cluster of {NODES} nodes / in as many processes, - 1",
            at_most(20.0),
        ),
        Figure("remote_episode_ms", 1000 * remote_s / len(jobs), "ms", "an episode on the cluster"),
        Figure("local_episode_ms", 1000 * local_s / len(jobs), "ms", "an episode in the processes"),
    ]


@contextmanager
def _cluster() -> Iterator[str]:
    """The address of a cluster of NODES nodes on this machine; it ends with the block."""
    os.environ.setdefault("RAY_worker_niceness", "0")  # as the other side's processes have it
    from ray.cluster_utils import Cluster

    cluster = Cluster()
    try:
        for _ in range(NODES):
            cluster.add_node(num_cpus=1, include_dashboard=False)
        cluster.wait_for_nodes()
        yield cluster.address
    finally:
        cluster.shutdown()
