"""Episodes one after the other in this process."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import BaseModel

from islandgp.domain import Outcome
from islandgp.evaluation.base import Job, Problem, simulate


class SerialSettings(BaseModel, frozen=True, extra="forbid"):
    """Nothing to choose."""


class Serial:
    """The evaluator without workers."""

    Settings = SerialSettings

    @classmethod
    def make(cls, settings: SerialSettings, problem: Problem) -> Serial:  # noqa: ARG003 -- the protocol's
        """See `Evaluator`."""
        return cls(problem)

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.simulated = 0

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.simulated += len(jobs)
        return [simulate(self.problem, job) for job in jobs]

    def close(self) -> None:
        """See `Evaluator`."""
