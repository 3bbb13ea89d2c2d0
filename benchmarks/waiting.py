"""How much of several cores a generation can use, if nothing but its episodes takes time."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heapreplace
from time import process_time

from benchmarks.pinned import SEED
from islandgp.config.settings import Settings
from islandgp.domain import Outcome
from islandgp.evaluation.base import Cached, Job, Problem, simulate
from islandgp.evolution.loop import evolve
from islandgp.running.parts import make_supervisor


class _Timed:
    """An evaluator in this process that writes down what each episode took."""

    def __init__(self, setting: Problem) -> None:
        self.setting = setting
        self.simulated = 0
        self.batches: list[list[float]] = []  # s of processor time

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.simulated += len(jobs)
        outcomes, seconds = [], []
        for job in jobs:
            began = process_time()
            outcomes.append(simulate(self.setting, job))
            seconds.append(process_time() - began)
        self.batches.append(seconds)
        return outcomes

    def close(self) -> None:
        """See `Evaluator`."""


def episode_seconds(chosen: Settings) -> list[list[float]]:
    """Seconds of each episode, by generation."""
    domain = chosen.make_domain()
    timed = _Timed(Problem(domain, chosen.curriculum))
    for _ in evolve(chosen.plan(domain), SEED, make_supervisor(chosen, None), Cached(timed)):
        pass
    return timed.batches


def limit(batches: Sequence[Sequence[float]], workers: int) -> float:
    """Percent of `workers` cores in use if nothing but episodes took time.

    Each episode goes to the worker that is free first, and a generation ends with
    its last episode.
    """
    spans = 0.0
    for batch in batches:
        busy = [0.0] * workers  # a heap
        for seconds in batch:
            heapreplace(busy, busy[0] + seconds)
        spans += max(busy)
    return 100 * sum(map(sum, batches)) / (workers * spans)
