"""Trials that are stopped before their end because others are better.

The search and its runs share this process's memory, so it works where the launcher
runs the jobs in the process of the search.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol


class OptunaTrial(Protocol):
    """What Optuna's LiveTrial gives to a run."""

    def report(self, value: float, step: int) -> None:
        """Takes a generation's highest fitness."""

    def should_prune(self) -> bool:
        """Whether the run is to be stopped here."""


@dataclass(slots=True)
class LiveTrial:
    """A trial that is at work in this process."""

    judge: OptunaTrial
    pruned: int | None = None  # the generation in which it was stopped


class Pruned(Exception):
    """A run was stopped because other trials are better."""


AT_WORK: Final[dict[int, LiveTrial]] = {}
"""The trials that may be stopped, by the number of their job in Hydra's count."""


def follow(trial: LiveTrial, generation: int, best: float) -> None:
    """Reports a generation. Raises Pruned where the run is to be stopped."""
    trial.judge.report(best, generation)
    if trial.judge.should_prune():
        trial.pruned = generation
        raise Pruned
