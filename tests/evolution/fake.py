"""An evaluator that simulates nothing: outcomes come from a hash of the job."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from islandgp.domain import Outcome
from islandgp.evaluation.base import Job
from tests.samples import outcome


def outcome_of(job: Job) -> Outcome:
    """An outcome that depends on nothing but the job; who lacks an action never does it."""
    digest = hashlib.sha256(f"{job.tree}|{job.stage}|{job.seed}".encode()).digest()
    rng = np.random.default_rng(int.from_bytes(digest[:8], "big"))
    draws = rng.integers(0, 8, 4)
    names = ("PickupGarbage", "MoveToHumanoid", "DeliverToClearingPoint", "ExecuteCharge")
    pickups, interactions, deliveries, charges = (
        float(draw) if name in job.tree else 0.0 for draw, name in zip(draws, names, strict=True)
    )
    fitness = float(rng.integers(-2000, 8000)) + 1500 * (pickups + interactions)
    return outcome(
        components={"garbage": fitness},
        pickups=pickups,
        interactions=interactions,
        deliveries=deliveries,
        charges=charges,
        gathered=pickups + 5 * interactions,
        distance=float(rng.integers(0, 2000)),
    )


class Fake:
    """See `Evaluator`; keeps the jobs that it evaluated, by batch."""

    def __init__(self) -> None:
        self.batches: list[list[Job]] = []

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.batches.append(list(jobs))
        return [outcome_of(job) for job in jobs]

    def close(self) -> None:
        """See `Evaluator`."""
