"""A sweep whose jobs an optimiser chooses while it runs: `hydra/sweeper=optuna`.

Each job adds itself to sweep.json when it begins, in the process started by a launcher, and returns
the values of `objectives`.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from math import nan
from pathlib import Path
from textwrap import indent
from time import time
from typing import Any, Final, Literal
from uuid import uuid4

import yaml
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.types import IntervalSweep, Override
from omegaconf import DictConfig
from pydantic import BaseModel, Field, ValidationError

from islandgp.config.compose import MAX_JOBS, Planned, Searched, plain
from islandgp.config.error_lines import setting_at
from islandgp.config.naming import command_line, run_folder
from islandgp.config.settings import Settings, read_settings
from islandgp.errors import ConfigError, RunError, brief
from islandgp.records.files import NOT_VALIDATED, objectives
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import redacted, without_credentials
from islandgp.running.printing import echo, tolerant_stderr
from islandgp.running.resume import choose
from islandgp.running.run import Pruned
from islandgp.sweep.folder import SweepFolder, SweepJob
from islandgp.sweep.job import attempt, fitted, sweep_entry
from islandgp.sweep.progress import Start
from islandgp.sweep.run import Launch, end_ray, finish_sweep, jobs_in, launched
from islandgp.trust import names_in, trust

RESULTS: Final = "optimization_results.yaml"
"""File name for the results of Hydra's optimising sweepers."""

SWEEPER: Final = "hydra_plugins.islandgp_optuna.OptunaSweeper"

Direction = Literal["minimize", "maximize"]


class SweeperSettings(BaseModel, frozen=True, extra="forbid"):
    """The keys of `conf/hydra/sweeper/optuna.yaml`."""

    n_trials: int = Field(ge=1, le=MAX_JOBS)
    n_jobs: int = Field(ge=1, le=MAX_JOBS)
    direction: Direction | tuple[Direction, ...]
    params: dict[str, Any]
    sampler: dict[str, Any]  # conf/hydra/sweeper/sampler
    pruner: dict[str, Any] | None = None  # conf/hydra/sweeper/pruner; None: no pruning


@dataclass(frozen=True, slots=True)
class TrialSearch:
    """State of a search at its start. It is sent to the jobs, so it has plain values only."""

    id: str
    at: float  # s since 1970
    folder: Path  # the sweep's
    flags: tuple[str, ...]  # of each job's command
    at_once: int  # jobs per launch; 1 if unknown
    trials: int  # total number; 0 if unknown

    def start(self) -> Start:
        """The trials that have begun so far."""
        file = SweepFolder(self.folder).read()
        jobs = {
            self.folder / job.slot: job
            for job in (file.jobs if file else ())
            if job.search == self.id
        }
        return Start(self.at, jobs, 0, {}, self.trials, self.folder.name)


def run_search(searched: Searched, command: str, launch: Launch) -> int:
    """Runs the sweeper, which chooses and launches jobs; returns the exit code as `run_sweep`.

    Raises:
        ConfigError: the sweeper's configuration is wrong.
        RunError: another sweep is at work in the same folder, or the sweeper failed.
    """
    check(searched)
    first = searched.ends[0]
    if len({job.folder.parent for job in searched.ends}) > 1:
        raise ConfigError(
            "name: expected one name for all trials of a search, found several; give one name=..."
        )
    sweep = SweepFolder(first.folder.parent)
    search = TrialSearch(
        uuid4().hex,
        time(),
        sweep.path,
        searched.flags,
        int(searched.sweeper.get("n_jobs", 1)),
        int(searched.sweeper.get("n_trials", 0)),
    )
    interrupted = False
    sweep.open(command, ())
    results = sweep.path / RESULTS
    try:
        results.unlink(missing_ok=True)
        launched(sweep.path, first, search.start, search_job(search), launch)
    except KeyboardInterrupt:
        interrupted = True
    except Exception as error:
        cause = error.__cause__ if isinstance(error.__cause__, Exception) else error
        raise RunError(
            f"Expected the sweeper to search, found that it cannot: {brief(cause)};"
            " change hydra.sweeper or hydra.launcher. Trials that are finished are kept."
        ) from error
    finally:
        entries = {sweep: search.start().jobs}
        end_ray(entries)
        sweep.close()
    jobs = jobs_in(entries)
    pruned = sum(job.pruned is not None for _, job in jobs)
    failed = sum(bool(run.error()) for run, _ in jobs)
    echo(f"\nSearch: {len(jobs)} different runs, {pruned} pruned, {failed} failed")
    if results.exists():
        echo(best_lines(yaml.safe_load(results.read_bytes()), first.settings.objectives))
    return finish_sweep(entries, [first.settings], interrupted)


def best_lines(results: Mapping[str, Any], names: Sequence[str]) -> str:
    """The results of a sweeper (RESULTS) as text.

    Args:
        results: in the form of Optuna's sweepers, best_params and best_value, or solutions with
            params and values; those of other sweepers are shown as they are.
        names: the objectives.
    """
    if "solutions" in results:
        title = "None of these is worse than another one in every objective:"
        solutions = results["solutions"]
    elif "best_params" in results:
        title = "Best:"
        solutions = [{"params": results["best_params"], "values": [results["best_value"]]}]
    else:
        return f"Best:\n{indent(yaml.safe_dump(dict(results), sort_keys=False), '  ').rstrip()}"
    lines = [
        f"  {', '.join(f'{n} {v:,.6g}' for n, v in zip(names, one['values'], strict=True))}"
        f" with {' '.join(f'{key}={value}' for key, value in one['params'].items())}"
        for one in solutions
        if one["params"] is not None
    ]
    return "\n".join([title, *lines]) if lines else "No run came to its end."


def check(searched: Searched) -> None:
    """Raises ConfigError if Optuna cannot search; other sweepers check this themselves."""
    first = searched.ends[0]
    for override in searched.sweeps:
        _must_be_whole(override, first.settings)
    if searched.sweeper.get("_target_") != SWEEPER:
        return
    if find_spec("optuna") is None:
        raise ConfigError(
            "hydra/sweeper: expected Optuna, found it not installed; pip install 'islandgp[optuna]'"
        )
    _must_fit_together(_sweeper_settings(searched.sweeper), first)
    if not searched.sweeps:
        raise ConfigError(
            "Expected something to search, found no sweep; for instance"
            " 'gp.mutation_rate=interval(0.05,0.9)'."
        )
    from islandgp.sweep.optuna_trials import axis

    for override in searched.sweeps:
        try:
            axis(override)
        except ValueError as error:
            raise ConfigError(
                f"{override.input_line}: expected values to search, found that Optuna cannot:"
                f" {brief(error)}"
            ) from None


def _sweeper_settings(sweeper: Mapping[str, Any]) -> SweeperSettings:
    try:
        return SweeperSettings(**{key: v for key, v in sweeper.items() if key != "_target_"})
    except ValidationError as error:
        lines = {
            e["loc"][0]: f"hydra.sweeper.{e['loc'][0]}={e['input']!r}:"
            f" {e['msg'][:1].lower()}{e['msg'][1:]}"
            for e in reversed(error.errors())
        }
        raise ConfigError("\n".join(lines.values())) from None


def _must_fit_together(settings: SweeperSettings, first: Planned) -> None:
    """Raises ConfigError for a sweeper that does not fit the jobs, or Optuna."""
    n = 1 if isinstance(settings.direction, str) else len(settings.direction)
    aims = first.settings.objectives
    if n != len(aims):
        raise ConfigError(
            f"hydra.sweeper.direction: expected one for each of the {len(aims)} objectives"
            f" ({', '.join(aims)}), found {n}; write"
            f" hydra.sweeper.direction=[{','.join(['maximize'] * len(aims))}]."
        )
    if "validation_mean" in aims and first.settings.gp.validation == 0:
        raise ConfigError(NOT_VALIDATED)
    for key, part in (("sampler", settings.sampler), ("pruner", settings.pruner)):
        target = str(part.get("_target_")) if part else ""
        if part and not target.startswith(f"optuna.{key}s."):
            raise ConfigError(
                f"hydra.sweeper.{key}._target_: expected a class of optuna.{key}s, found {target}."
            )
    if settings.pruner and (first.launcher != "BasicLauncher" or n > 1 or settings.n_jobs > 1):
        raise ConfigError(
            "hydra/sweeper/pruner: expected one objective, hydra.sweeper.n_jobs=1 and the basic"
            f" launcher, found {n}, {settings.n_jobs} and {first.launcher}: trials can be stopped"
            " only one after the other in this process; leave the pruner out, or the others."
        )


def _must_be_whole(override: Override, settings: Settings) -> None:
    """Raises ConfigError for an interval of decimals if the key's values are whole numbers."""
    values = override.value()
    value: Any = settings
    for part in override.key_or_group.split("."):
        value = setting_at(value, part)
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if isinstance(values, IntervalSweep) and is_whole and isinstance(values.start, float):
        key = override.get_key_element()
        text = str(override.input_line).partition("=")[2]
        raise ConfigError(
            f"{override.input_line}: expected an interval of whole numbers, found one of"
            f" decimals; write '{key}=int({text})'."
        )


PRUNING: Final[dict[int, Callable[[int, float], bool]]] = {}
"""Pruning functions by Hydra's job number: called with a generation and its highest fitness, True
to stop the trial. Filled by the sweeper, so pruning needs a launcher that runs the jobs in the
sweeper's process."""


def search_job(search: TrialSearch) -> Callable[[DictConfig], float | tuple[float, ...] | None]:
    """The function that Hydra calls for each trial.

    It returns the objectives, None for a pruned trial, and NaN for a failed one, whose folder has
    the error.
    """

    def job(config: DictConfig) -> float | tuple[float, ...] | None:
        multiprocessing.set_start_method(None, force=True)  # as in `sweep_job`
        hydra = HydraConfig.get()
        home, overrides = Path(hydra.runtime.cwd), list(hydra.overrides.task)
        plain_config = plain(config)
        named = run_folder(plain_config, overrides, home)
        command = command_line([*search.flags, *overrides])
        with tolerant_stderr():
            try:
                trust(names_in(plain_config))
                settings = read_settings(plain_config)
                target = choose(RunFolder(named), settings, redacted(plain_config))
            except (ConfigError, RunError) as error:
                # It failed, and its folder has the error.
                folder = RunFolder(named)
                if folder.begun():  # it is another run's
                    folder = RunFolder(named.with_name(f"{named.name}~refused"))
                where = folder.path
                SweepFolder(search.folder).enter(
                    sweep_entry(plain_config, overrides, where, where, command, search.id)
                )
                folder.fail(error)
                print(f"islandgp: {without_credentials(str(error))}", file=sys.stderr)
                return nan
            entry = sweep_entry(plain_config, overrides, named, target.path, command, search.id)
            judge = PRUNING.get(int(hydra.job.num))
            fitted_settings = fitted(settings, hydra.launcher, search.at_once)
            return _run(search, entry, plain_config, fitted_settings, home, judge)

    return job


def _run(
    search: TrialSearch,
    entry: SweepJob,
    config: dict[str, Any],
    settings: Settings,
    home: Path,
    judge: Callable[[int, float], bool] | None,
) -> float | tuple[float, ...] | None:
    sweep = SweepFolder(search.folder)
    sweep.enter(entry)
    target = sweep.run(entry)
    if judge is not None and target.finished():
        for record in target.records():  # for the judgement of other trials
            judge(record["snapshot"]["generation"], record["snapshot"]["best"])

    def judged(generation: int, best: float) -> None:
        assert judge is not None
        if judge(generation, best):
            sweep.enter(replace(entry, pruned=generation))
            raise Pruned

    watched = None if judge is None else judged
    try:
        attempt(target, config, settings, home, entry.command, search.start, watched)
    except Pruned:
        return None
    if not target.finished():
        return nan
    try:
        scores = objectives(target.summary(), settings.objectives)
    except RunError as error:
        print(f"islandgp: {target.path.name}: {error}", file=sys.stderr)
        return nan
    return scores[0] if len(scores) == 1 else scores
