"""A search by Optuna: asks for trials, launches them as jobs, and reports their results.

With a seed in the sampler, the same command asks for the same trials, and finished runs are not
repeated. So the same command continues a search that was stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

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

from islandgp.atomic_files import write_atomic
from islandgp.sweep.optimiser import PRUNING, Direction

Words = tuple[str, ...]
"""The overrides of a job."""

Outcome = tuple[float, ...] | None
"""A job's objectives; () if it failed, None if it was pruned."""

Launch = Callable[[Sequence[Sequence[str]], int], Sequence[JobReturn]]
"""Hydra's launcher: (overrides of the jobs, number of the first) -> their results."""


@dataclass(frozen=True, slots=True)
class Axis:
    """One key that is searched."""

    key: str  # as in an override, including a leading +
    distribution: BaseDistribution
    texts: tuple[str, ...] = ()  # the values as texts in overrides, if they are countable

    def override(self, value: Any) -> str:
        """The override for a value chosen by Optuna."""
        if isinstance(self.distribution, IntDistribution) and self.texts:
            value = self.texts[value]
        return f"{self.key}={value}"


def axis(sweep: Override) -> Axis:
    """An axis of the search: Optuna's distribution for the values of a sweep.

    Choices are a categorical distribution. A range is searched by the index of its values, because
    Hydra's decimals have no exact floats.
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
    arguments: Sequence[str],
    launch: Launch,
    results: Path,
    *,
    n_trials: int,
    n_jobs: int,
    direction: Direction | Sequence[Direction],
    params: Mapping[str, Any],
    sampler: optuna.samplers.BaseSampler,
    pruner: optuna.pruners.BasePruner | None = None,
) -> None:
    """Runs the trials, and writes the best into the file `results`.

    A job returns its objectives, or None if it was pruned; it failed where one
    of them is not a number. The settings are the keys of `conf/hydra/sweeper/optuna.yaml`, which
    `sweep.optimiser` has checked; without a pruner every trial runs to its end.
    """
    overrides = [*(f"{key}={value}" for key, value in params.items()), *arguments]
    last = {o.get_key_element(): o for o in OverridesParser.create().parse_overrides(overrides)}
    axes = [axis(override) for override in last.values() if override.is_sweep_override()]
    fixed = [_fixed(o) for o in last.values() if not o.is_sweep_override()]
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        sampler=sampler,
        pruner=pruner or optuna.pruners.NopPruner(),
        directions=[direction] if isinstance(direction, str) else [*direction],
    )
    space = {a.key: a.distribution for a in axes}
    outcomes: dict[Words, Outcome] = {}
    while (done := len(study.trials)) < n_trials:
        batch = [study.ask(space) for _ in range(min(n_jobs, n_trials - done))]
        jobs = [(*fixed, *(a.override(trial.params[a.key]) for a in axes)) for trial in batch]
        new = {job: trial for job, trial in zip(jobs, batch, strict=True) if job not in outcomes}
        outcomes |= _launched(new, launch, len(outcomes), bool(pruner))
        for trial, job in zip(batch, jobs, strict=True):
            state = TrialState.PRUNED if outcomes[job] is None else TrialState.FAIL
            study.tell(trial, outcomes[job] or None, None if outcomes[job] else state)
    plain = yaml.safe_dump(_results(study, axes), sort_keys=False)
    write_atomic(results, plain.encode())


def _launched(
    jobs: Mapping[Words, optuna.Trial], launch: Launch, first: int, prune: bool
) -> dict[Words, Outcome]:
    """Launches jobs, which get the numbers from `first` on."""
    if prune:
        PRUNING.update((first + n, partial(_judge, trial)) for n, trial in enumerate(jobs.values()))
    try:
        returned = launch(list(jobs), first) if jobs else ()
    finally:
        PRUNING.clear()
    return dict(zip(jobs, map(_outcome, returned), strict=True))


def _judge(trial: optuna.Trial, generation: int, best: float) -> bool:
    trial.report(best, generation)
    return trial.should_prune()


def _fixed(override: Override) -> str:
    if override.is_delete():
        return str(override.input_line)
    return f"{override.get_key_element()}={override.get_value_element_as_str()}"


def _outcome(returned: JobReturn) -> Outcome:
    try:
        value = returned.return_value
    except Exception:  # of the job; its folder has it
        return ()
    if value is None:
        return None
    values = tuple(float(v) for v in (value if isinstance(value, tuple | list) else [value]))
    return values if all(map(isfinite, values)) else ()


def _results(study: optuna.Study, axes: Sequence[Axis]) -> dict[str, Any]:
    """The best trials, in the form of Hydra's sweepers."""
    best = study.best_trials
    solutions = [{"params": _params(t, axes), "values": list(t.values)} for t in best]
    if len(study.directions) > 1:
        return {"name": "optuna", "solutions": solutions}
    return {
        "name": "optuna",
        "best_params": _params(best[0], axes) if best else None,
        "best_value": best[0].values[0] if best else None,
    }


def _params(trial: FrozenTrial, axes: Sequence[Axis]) -> dict[str, Any]:
    """The values of a trial as its overrides have them."""
    assignments = [a.override(trial.params[a.key]).partition("=") for a in axes]
    return {key.lstrip("+"): yaml.safe_load(text) for key, _, text in assignments}
