"""Episodes in this process, one after another."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import BaseModel, Field

from islandgp.domain import Outcome
from islandgp.evaluation.base import Job, Problem, simulate


class SerialSettings(BaseModel, frozen=True, extra="forbid"):
    """Time limit of an episode."""

    episode_timeout: float = Field(600, ge=0, le=1e6)  # s until an episode is given up; 0: never


class Serial:
    """The evaluator without worker processes."""

    Settings = SerialSettings

    @classmethod
    def make(cls, settings: SerialSettings, problem: Problem) -> Serial:
        """See `Evaluator`."""
        return cls(problem, episode_timeout=settings.episode_timeout)

    def __init__(self, problem: Problem, *, episode_timeout: float = 0) -> None:
        """An episode that takes more than `episode_timeout` seconds ends the run; 0: none does."""
        self.problem = problem
        self.episode_timeout = episode_timeout

    def evaluate(self, jobs: Iterable[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        return [simulate(self.problem, job, self.episode_timeout) for job in jobs]

    def close(self) -> None:
        """See `Evaluator`."""
