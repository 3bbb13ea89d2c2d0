"""Evaluators that configuration can choose, for tests of everything around the simulator."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import BaseModel

from islandgp.domain import Outcome
from islandgp.domains.island.domain import Island
from islandgp.errors import EvaluationError
from islandgp.evaluation.base import Job, Problem
from tests.evolution.fake import Fake, outcome_of


class NoSettings(BaseModel, frozen=True, extra="forbid"):
    """Nothing to choose."""

    episode_timeout: float = 0  # as the settings of `serial`, whose file is taken


class Instant(Fake):
    """Made-up outcomes at once; keeps nothing, so that a long run's memory is its own."""

    Settings = NoSettings

    @classmethod
    def make(cls, settings: NoSettings, problem: Problem) -> Instant:  # noqa: ARG003 -- the protocol's
        """See `Evaluator`."""
        return cls()

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        return [outcome_of(job) for job in jobs]


class Lasting(Fake):
    """Made-up outcomes times an episode's length, so that longer episodes are better."""

    Settings = NoSettings

    @classmethod
    def make(cls, settings: NoSettings, problem: Problem) -> Lasting:  # noqa: ARG003 -- the protocol's
        """See `Evaluator`."""
        assert isinstance(problem.domain, Island)
        return cls(problem.domain.world.episode.length)

    def __init__(self, length: float) -> None:
        super().__init__()
        self.length = length  # s

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        return [self._scaled(outcome) for outcome in super().evaluate(jobs)]

    def _scaled(self, outcome: Outcome) -> Outcome:
        points = {name: self.length * value for name, value in outcome.components.items()}
        return replace(outcome, components=points)


class BreaksSettings(BaseModel, frozen=True, extra="forbid"):
    """When to break."""

    episode_timeout: float = 0  # as the settings of `serial`, whose file is taken

    after: int  # generations that go well
    how: str  # "error", "fault", "interrupt" or "kill"
    unless: str = ""  # a file that, when it exists, makes all well
    mark: bool = False  # make that file before breaking: so it breaks once


class Breaks(Fake):
    """Made-up outcomes for some generations, and then trouble."""

    Settings = BreaksSettings

    @classmethod
    def make(cls, settings: BreaksSettings, problem: Problem) -> Breaks:  # noqa: ARG003 -- the protocol's
        """See `Evaluator`."""
        return cls(settings)

    def __init__(self, settings: BreaksSettings) -> None:
        super().__init__()
        self.settings = settings
        self.calls = 0

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.calls += 1
        settings = self.settings
        well = settings.unless and Path(settings.unless).exists()
        if self.calls > settings.after and not well:
            if settings.mark:
                Path(settings.unless).touch()
            if settings.how == "error":
                raise EvaluationError("Expected an outcome, found trouble.")
            if settings.how == "interrupt":
                raise KeyboardInterrupt
            if settings.how == "kill":
                os.kill(os.getpid(), 9)
            raise ZeroDivisionError("a fault of the program")
        return super().evaluate(jobs)


class SlowSettings(BaseModel, frozen=True, extra="forbid"):
    """How slow."""

    episode_timeout: float = 0  # as the settings of `serial`, whose file is taken

    seconds: float  # a generation


class Slow(Fake):
    """Made-up outcomes that take a time, so that a test can interrupt between them."""

    Settings = SlowSettings

    @classmethod
    def make(cls, settings: SlowSettings, problem: Problem) -> Slow:  # noqa: ARG003 -- the protocol's
        """See `Evaluator`."""
        return cls(settings.seconds)

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.seconds = seconds

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        time.sleep(self.seconds)
        return super().evaluate(jobs)
