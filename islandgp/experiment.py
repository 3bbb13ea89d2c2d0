"""Experiments in Python: composed like on the command line, run generation by generation.

experiment = islandgp.compose("gp.population=12", "supervisor=baseline")
for step in experiment:
    print(step.record.snapshot.best)
experiment.evaluate(step.champion.record.tree, worlds=range(10))

`search` and `evaluate_population` are the parts of a loop that you write yourself (docs/search.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.config.settings import Settings
from islandgp.domain import Domain, Outcome
from islandgp.errors import ConfigError
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evaluate, evolve, training_seeds
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated, Individual
from islandgp.gp.record import Step
from islandgp.results import Results, load
from islandgp.search.base import Search


@dataclass(frozen=True)
class Experiment:
    """One run's settings, validated."""

    settings: Settings
    config: dict[str, Any]  # resolved, as plain values
    folder: Path  # where `run` keeps the records

    @cached_property
    def domain(self) -> Domain:
        """The world that its trees live in."""
        return self.settings.make_domain()

    def __iter__(self) -> Iterator[Step]:
        """Evolves, a generation at a time, in this process; nothing is written."""
        from islandgp.running.run import make_supervisor

        supervisor = make_supervisor(self.settings, None)
        evaluator, seed = Serial(self.settings.problem()), self.settings.seed
        yield from evolve(self.plan, seed, supervisor, evaluator, search=self.search())

    @cached_property
    def plan(self) -> Plan:
        """What a run of it is made of: the limits, the settings of the operators, the classes."""
        from islandgp.running.run import plan_of

        return plan_of(self.settings, self.domain)

    @cached_property
    def _evaluator(self) -> Serial:
        return Serial(self.settings.problem())

    def search(self) -> Search:
        """The search that it chooses, to be asked for individuals and told what they achieve.

        Raises:
            ConfigError: the search cannot work with these settings.
        """
        from islandgp.running.run import make_search

        return make_search(self.settings, self.plan)

    def evaluate_population(
        self,
        individuals: Sequence[Individual],
        generation: int = 0,
        *,
        worlds: Iterable[int] | None = None,
    ) -> tuple[Evaluated, ...]:
        """What individuals achieve in a generation, one after the other in this process.

        Args:
            individuals: as `search().ask` returns them.
            generation: whose stage of the curriculum scores them, from 0.
            worlds: seeds of the worlds that each of them meets, from 0 to 2**32 - 1; None: the
                worlds of a run's generation.

        Raises:
            ConfigError: there is no such world or generation.
        """
        if not (isinstance(generation, int | np.integer) and generation >= 0):
            raise ConfigError(f"generation: expected 0 or more, found {generation!r}")
        plan = self.plan
        if worlds is None:
            seeds = list(training_seeds(plan, self.settings.seed, int(generation)))
        else:
            seeds = _seeds(worlds)
            if not seeds:
                raise ConfigError("worlds: expected at least one seed, found none")
            shared = {"episodes": len(seeds), "common_world": True}
            plan = replace(plan, gp=plan.gp.model_copy(update=shared))
        texts = [to_text(i.tree) for i in individuals]
        return evaluate(plan, int(generation), individuals, texts, seeds, self._evaluator)

    def parse(self, text: str) -> Node:
        """A tree in the words of the domain. Raises TreeError."""
        return parse(text, self.domain.schema.vocabulary)

    def evaluate(
        self, tree: Node | str, worlds: Iterable[int] = range(30), *, stage: int | None = None
    ) -> list[Outcome]:
        """A tree's outcome in each world.

        Args:
            tree: or its text.
            worlds: seeds, from 0 to 2**32 - 1; worlds of evolution have others.
            stage: index of the curriculum's stage that scores the episodes; None: the last.

        Raises:
            TreeError: the text is not a tree of the domain.
            ConfigError: there is no such stage or world.
        """
        node = self.parse(tree) if isinstance(tree, str) else self.parse(to_text(tree))
        last = len(self.settings.curriculum.stages) - 1
        stage = last if stage is None else stage
        if stage not in range(last + 1):
            raise ConfigError(f"stage: expected 0 to {last}, found {stage!r}")
        seeds = _seeds(worlds)
        problem = self.settings.problem()
        weights = self.settings.curriculum.multipliers(stage)
        return [problem.in_world(stage, s).run_episode(node, s, weights) for s in seeds]

    def run(self) -> Results:
        """Runs it as the command does, or what is missing of it, with records and tracking.

        In a script this belongs below `if __name__ == "__main__":`, as the evaluator starts
        processes; `evaluator=serial` starts none.

        Raises:
            IslandError: as the command would end with.
        """
        from islandgp.running.run import run

        run(self.settings, self.config, self.folder, home=Path.cwd())
        return load(self.folder)


def _seeds(worlds: Iterable[Any]) -> list[int]:
    """The seeds of worlds as integers. Raises ConfigError."""
    seeds = list(worlds)
    if odd := [w for w in seeds if not (isinstance(w, int | np.integer) and 0 <= w < 2**32)]:
        raise ConfigError(f"worlds: expected seeds from 0 to {2**32 - 1}, found {odd[0]!r}")
    return [int(w) for w in seeds]


def compose(*overrides: str, config_dir: str | Path | None = None) -> Experiment:
    """The experiment that `python -m islandgp OVERRIDES` runs.

    Raises:
        ConfigError: with one line for each wrong key or value.
    """
    from islandgp.config.compose import only_job

    job = only_job(overrides, config_dir)
    return Experiment(job.settings, job.config, job.folder)


def run(*overrides: str, config_dir: str | Path | None = None) -> Results:
    """Composes an experiment and runs it, as `Experiment.run` does."""
    return compose("progress=off", *overrides, config_dir=config_dir).run()
