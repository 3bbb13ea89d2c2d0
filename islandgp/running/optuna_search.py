"""A search by Optuna: trials are asked for, launched as jobs, and told their results.

With a seed in the sampler the same command asks for the same trials: finished runs are
taken as they are, so a search that was stopped goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import optuna
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import IntervalSweep, Override
from hydra.core.utils import JobReturn
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.trial import FrozenTrial, TrialState

from islandgp.records.checkpoint import write_atomic
from islandgp.running.pruning import AT_WORK, LiveTrial

Direction = Literal["minimize", "maximize"]

Words = tuple[str, ...]
"""The overrides of a job."""

Launch = Callable[[Sequence[Sequence[str]], int], Sequence[JobReturn]]
"""Hydra's launcher: the overrides of jobs and the number of the first; what they returned."""


@dataclass(frozen=True, slots=True)
class OptunaSettings:
    """The keys of `conf/hydra/sweeper/optuna.yaml`; `config.search` has checked them."""

    n_trials: int
    n_jobs: int
    direction: Direction | Sequence[Direction]
    params: Mapping[str, Any]
    sampler: optuna.samplers.BaseSampler
    pruner: Any = None  # a pruner of Optuna's; else every trial runs to its end

    def directions(self) -> list[Direction]:
        """One for each objective."""
        given = self.direction
        return [given] if isinstance(given, str) else [*given]


@dataclass(frozen=True, slots=True)
class Axis:
    """One key that is searched."""

    key: str  # as in an override, with its +
    distribution: BaseDistribution
    texts: tuple[str, ...] = ()  # the values as overrides have them, where they can be counted

    def override(self, value: Any) -> str:
        """The override for a value that Optuna has chosen."""
        if isinstance(self.distribution, IntDistribution) and self.texts:
            value = self.texts[value]
        return f"{self.key}={value}"


def axis(sweep: Override) -> Axis:
    """The values of a sweep as Optuna's distribution.

    Choices are categories. A range is the place of its values in their order, since its
    numbers as Hydra spells them are decimals that floats only come near.
    """
    key, value = sweep.get_key_element(), sweep.value()
    if not isinstance(value, IntervalSweep):
        texts = tuple(sweep.sweep_string_iterator())
        if sweep.is_range_sweep():
            return Axis(key, IntDistribution(0, len(texts) - 1), texts)
        return Axis(key, CategoricalDistribution(tuple(dict.fromkeys(texts))))
    low, high, log = value.start, value.end, "log" in value.tags
    assert low is not None
    assert high is not None
    if isinstance(low, int) and isinstance(high, int):
        return Axis(key, IntDistribution(low, high, log=log))
    return Axis(key, FloatDistribution(low, high, log=log))


def search(
    settings: OptunaSettings, arguments: Sequence[str], launch: Launch, results: Path
) -> None:
    """Runs the trials, and writes the best into the file `results`.

    A job returns its objectives; it failed where one of them is not a number.
    """
    words = [*(f"{key}={value}" for key, value in settings.params.items()), *arguments]
    last = {o.get_key_element(): o for o in OverridesParser.create().parse_overrides(words)}
    axes = [axis(override) for override in last.values() if override.is_sweep_override()]
    fixed = [_fixed(o) for o in last.values() if not o.is_sweep_override()]
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    pruner = settings.pruner if isinstance(settings.pruner, optuna.pruners.BasePruner) else None
    study = optuna.create_study(
        sampler=settings.sampler,
        pruner=pruner or optuna.pruners.NopPruner(),
        directions=settings.directions(),
    )
    space = {a.key: a.distribution for a in axes}
    known: dict[Words, Returned] = {}
    while (told := len(study.trials)) < settings.n_trials:
        batch = [study.ask(space) for _ in range(min(settings.n_jobs, settings.n_trials - told))]
        jobs = [(*fixed, *(a.override(trial.params[a.key]) for a in axes)) for trial in batch]
        new = {job: trial for job, trial in zip(jobs, batch, strict=True) if job not in known}
        known |= _launched(new, launch, len(known), pruner is not None)
        for trial, job in zip(batch, jobs, strict=True):
            _tell(study, trial, known[job])
    plain = yaml.safe_dump(_results(study, axes), sort_keys=False)
    write_atomic(results, plain.encode())


@dataclass(frozen=True, slots=True)
class Returned:
    """The result of a job."""

    values: tuple[float, ...]  # its objectives; () where it did not come to its end
    pruned: bool


def _launched(
    jobs: Mapping[Words, optuna.Trial], launch: Launch, first: int, prune: bool
) -> dict[Words, Returned]:
    """Launches jobs, which get the numbers from `first` on."""
    trials = {first + n: LiveTrial(trial) for n, trial in enumerate(jobs.values())}
    if prune:
        AT_WORK.update(trials)
    try:
        returned = launch(list(jobs), first) if jobs else ()
    finally:
        AT_WORK.clear()
    return {
        job: Returned(_values(result), trial.pruned is not None)
        for job, result, trial in zip(jobs, returned, trials.values(), strict=True)
    }


def _fixed(override: Override) -> str:
    if override.is_delete():
        return str(override.input_line)
    return f"{override.get_key_element()}={override.get_value_element_as_str()}"


def _values(returned: JobReturn) -> tuple[float, ...]:
    """A job's objectives; () where it failed."""
    try:
        value = returned.return_value
    except Exception:  # whatever ended the job; its folder tells
        return ()
    values = tuple(float(v) for v in (value if isinstance(value, tuple | list) else [value]))
    return values if all(map(isfinite, values)) else ()


def _tell(study: optuna.Study, trial: optuna.Trial, outcome: Returned) -> None:
    if outcome.pruned:
        study.tell(trial, state=TrialState.PRUNED)
    elif outcome.values:
        study.tell(trial, outcome.values)
    else:
        study.tell(trial, state=TrialState.FAIL)


def _results(study: optuna.Study, axes: Sequence[Axis]) -> dict[str, Any]:
    """The best trials, in the form of Hydra's sweepers."""
    best = study.best_trials
    found = [{"params": _params(t, axes), "values": list(t.values)} for t in best]
    if len(study.directions) > 1:
        return {"name": "optuna", "solutions": found}
    return {
        "name": "optuna",
        "best_params": _params(best[0], axes) if best else None,
        "best_value": best[0].values[0] if best else None,
    }


def _params(trial: FrozenTrial, axes: Sequence[Axis]) -> dict[str, Any]:
    """The values of a trial as its overrides have them."""
    words = [a.override(trial.params[a.key]).partition("=") for a in axes]
    return {key.lstrip("+"): yaml.safe_load(text) for key, _, text in words}
