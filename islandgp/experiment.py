"""Experiments in Python: composed as on the command line, run generation by generation.

experiment = islandgp.compose("gp.population=12", "supervisor=baseline")
for step in experiment:
    print(step.record.snapshot.fitness_max)
experiment.evaluate(step.champion.record.tree, worlds=range(10))

With `search` and `evaluate_population` you can write the loop yourself (docs/search.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node
from islandgp.config.compose import only_job
from islandgp.config.settings import Settings
from islandgp.domain import Domain, Outcome
from islandgp.errors import ConfigError
from islandgp.evaluation.base import evaluated
from islandgp.evaluation.serial import Serial
from islandgp.evolution.generation import evaluate, training_seeds
from islandgp.evolution.loop import evolve
from islandgp.gp.plan import Plan
from islandgp.gp.population import Evaluated, Individual
from islandgp.gp.record import GenerationRecord, Step
from islandgp.results import Results, load
from islandgp.running.parts import make_search, make_supervisor, plan_of
from islandgp.running.run import run as run_settings
from islandgp.search.base import Search


@dataclass(frozen=True)
class Experiment:
    """One run: its validated settings. Iterate over it for a `Step` per generation."""

    settings: Settings
    config: dict[str, Any]  # resolved, as plain values
    folder: Path  # where `run` keeps the records

    @cached_property
    def domain(self) -> Domain:
        """The domain in which trees are evaluated."""
        return self.settings.make_domain()

    def __iter__(self) -> Iterator[Step]:
        """Runs the evolution in this process and yields each generation; writes no files."""
        supervisor = make_supervisor(self.settings, None)
        evaluator, seed = Serial(self.settings.problem()), self.settings.seed
        yield from evolve(self.plan, seed, supervisor, evaluator, search=self.search())

    @cached_property
    def plan(self) -> Plan:
        """The plan of the run: tree limits, settings of the operators, behaviour classes."""
        return plan_of(self.settings, self.domain)

    @cached_property
    def _evaluator(self) -> Serial:
        return Serial(self.settings.problem())

    def search(self) -> Search:
        """Makes the configured search, for a loop of your own with `ask` and `tell`.

        Raises:
            ConfigError: the search does not support these settings.
        """
        return make_search(self.settings, self.plan)

    def evaluate_population(
        self,
        individuals: Iterable[Individual],
        generation: int = 0,
        *,
        worlds: Iterable[int] | None = None,
    ) -> tuple[Evaluated, ...]:
        """Evaluates individuals one after the other, in this process.

        Args:
            individuals: as returned by `search().ask`.
            generation: >= 0; the curriculum's stage of this generation scores the episodes.
            worlds: world seeds in [0, 2**32), one episode per individual and seed; None: the
                seeds that a run uses in this generation.

        Returns:
            One `Evaluated` per individual, in the same order.

        Raises:
            ConfigError: the generation is negative, or the seeds are empty or out of range.
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
            shared = {"episodes": len(seeds), "shared_seed": True}
            plan = replace(plan, gp=plan.gp.model_copy(update=shared))
        return evaluate(plan, int(generation), individuals, seeds, self._evaluator)[0]

    def parse(self, text: str) -> Node:
        """Parses a tree with the domain's vocabulary.

        Args:
            text: one tree in the language.

        Returns:
            The root node, with every `use` expanded.

        Raises:
            TreeError: the text is not a tree of the domain.
        """
        return parse(text, self.domain.schema.vocabulary)

    def evaluate(
        self, tree: Node | str, worlds: Iterable[int] = range(30), *, stage: int | None = None
    ) -> list[Outcome]:
        """Runs one tree for one episode in each world, in this process.

        Args:
            tree: a node or its text.
            worlds: world seeds in [0, 2**32). The seeds of training are drawn from this whole
                range, so the default ones are practically new to every tree.
            stage: index of the curriculum stage that scores the episodes, from 0; None: the last.

        Returns:
            One outcome per seed, in the order of `worlds`.

        Raises:
            TreeError: the text is not a tree of the domain.
            ConfigError: the stage does not exist, or a seed is out of range.
        """
        last = len(self.settings.curriculum.stages) - 1
        stage = last if stage is None else stage
        if stage not in range(last + 1):
            raise ConfigError(f"stage: expected 0 to {last}, found {stage!r}")
        text = to_text(self.parse(tree if isinstance(tree, str) else to_text(tree)))
        return evaluated(self._evaluator, [text], stage, _seeds(worlds))[0]

    def run(self, *, on_generation: Callable[[GenerationRecord], object] | None = None) -> Results:
        """Runs the experiment as the command line does, with records and tracking.

        A run that was interrupted is resumed.

        Args:
            on_generation: called with the record of each generation once it is on disk; if a run
                is resumed, first with its earlier ones. An exception that it raises stops the run,
                which the same call continues.

        Returns:
            The results of the finished run.

        Raises:
            IslandError: the error with which the command would end.
        """
        home = Path.cwd()
        run_settings(
            self.settings, self.config, self.folder, home=home, on_generation=on_generation
        )
        return load(self.folder)


def _seeds(worlds: Iterable[Any]) -> list[int]:
    """World seeds as a list of integers. Raises ConfigError for a seed out of range."""
    seeds = list(worlds)
    if odd := [w for w in seeds if not (isinstance(w, int | np.integer) and 0 <= w < 2**32)]:
        raise ConfigError(f"worlds: expected seeds from 0 to {2**32 - 1}, found {odd[0]!r}")
    return [int(w) for w in seeds]


def compose(*overrides: str, config_dir: str | Path | None = None) -> Experiment:
    """Composes an experiment from configuration, as `python -m islandgp OVERRIDES` does.

    Args:
        *overrides: Hydra overrides of one run, e.g. "gp.population=12", "experiment=quick".
        config_dir: folder with further YAML files, as `--config-dir`; None: no such folder.

    Returns:
        The experiment. Nothing is run or written yet.

    Raises:
        ConfigError: a key or a value is wrong; one line for each.
    """
    job = only_job(overrides, config_dir)
    return Experiment(job.settings, job.config, job.folder)


def run(
    *overrides: str,
    config_dir: str | Path | None = None,
    on_generation: Callable[[GenerationRecord], object] | None = None,
) -> Results:
    """Composes an experiment and runs it.

    Args:
        *overrides: Hydra overrides of one run, as for `compose`.
        config_dir: folder with further YAML files, as for `compose`.
        on_generation: callback for each generation, as for `Experiment.run`.

    Returns:
        The results of the finished run.

    Raises:
        IslandError: as `compose` and `Experiment.run`.
    """
    return compose("progress=off", *overrides, config_dir=config_dir).run(
        on_generation=on_generation
    )
