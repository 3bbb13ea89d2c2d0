"""Search hyperparameters with Optuna; each trial is one run.

    pip install optuna optuna-dashboard
    python examples/optuna_search.py experiment=smoke --trials 20
    optuna-dashboard sqlite:///optuna.db

Optuna's storage keeps the trials, and `runs/optuna` the runs. The same command continues a search
that was stopped, with the run that was interrupted. Several processes may run it at a time.
Edit `space` and `OBJECTIVES`. With one objective, poor trials are pruned; Optuna can't prune
trials with several.
"""

from __future__ import annotations

import argparse
import sys
import warnings

import optuna
from optuna.trial import TrialState

import islandgp

OBJECTIVES = {"validation_mean": "maximize"}
"""Columns of `Results.runs` with their directions, e.g. also {"mean_diversity": "maximize"}."""


def space(trial: optuna.Trial) -> list[str]:
    """The overrides of a trial: the search space."""
    return [
        f"gp.mutation_rate={trial.suggest_float('gp.mutation_rate', 0.05, 0.9)}",
        f"gp.tournament_size={trial.suggest_int('gp.tournament_size', 2, 5)}",
        f"supervisor={trial.suggest_categorical('supervisor', ['baseline', 'expert'])}",
    ]


TASK = ("domain", "world", "rewards", "curriculum", "classes")
"""Groups that define what points are."""
COMPARABLE = ("mean_diversity", "seconds")
"""Objectives that are not in points."""


def objective(trial: optuna.Trial, overrides: list[str]) -> tuple[float, ...]:
    """Run a trial; return its objectives."""
    varied = [word for word in space(trial) if word.lstrip("+").startswith(TASK)]
    if varied and (scaled := set(OBJECTIVES) - set(COMPARABLE)):
        sys.exit(
            f"Expected an objective that {varied[0].partition('=')[0]} does not define, found"
            f" {', '.join(scaled)}: its best trial would be the one with the most generous points;"
            " search over other keys, or sweep over these and use islandgp compare."
        )

    def prune(record: islandgp.GenerationRecord) -> None:
        trial.report(record.snapshot.fitness_max, record.snapshot.generation)
        if trial.should_prune():
            raise optuna.TrialPruned

    try:
        results = islandgp.run(
            "search=paper",  # which reads the keys of `space`
            *overrides,
            "name=optuna",
            *space(trial),
            on_generation=prune if len(OBJECTIVES) == 1 else None,
        )
    except KeyboardInterrupt:
        trial.study.enqueue_trial(trial.params)  # the next command continues this run
        raise
    trial.set_user_attr("run", str(results.path))
    return tuple(float(results.runs[name].iloc[0]) for name in OBJECTIVES)


def search(overrides: list[str], trials: int, url: str, seed: int | None = None) -> optuna.Study:
    """Run trials until the study has `trials` of them."""
    storage = optuna.storages.RDBStorage(
        url,
        heartbeat_interval=60,  # s; a trial whose process was killed is repeated
        heartbeat_stale_trial_callback=optuna.storages.RetryHeartbeatStaleTrialCallback(),
    )
    study = optuna.create_study(
        storage=storage,
        study_name=" ".join(["islandgp", *overrides]),
        directions=list(OBJECTIVES.values()),
        sampler=optuna.samplers.TPESampler(seed=seed),
        pruner=optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=10),
        load_if_exists=True,
    )
    ended = len(study.get_trials(states=(TrialState.COMPLETE, TrialState.PRUNED)))
    study.optimize(
        lambda trial: objective(trial, overrides),
        n_trials=max(0, trials - ended),
        catch=islandgp.IslandError,  # e.g. values that do not fit together
    )
    return study


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("overrides", nargs="*", help="of every run, e.g. experiment=smoke")
    parser.add_argument("--trials", type=int, default=20, help="number of trials in all")
    parser.add_argument("--storage", default="sqlite:///optuna.db", help="of Optuna")
    parser.add_argument("--seed", type=int, help="of Optuna's sampler; by default random")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # the heartbeat
    try:
        study = search(arguments.overrides, arguments.trials, arguments.storage, arguments.seed)
    except KeyboardInterrupt:
        sys.exit("stopped; the same command continues the search")
    if not study.get_trials(states=(TrialState.COMPLETE,)):
        sys.exit("no trial has completed; the first error is above")
    for trial in study.best_trials:  # several: none is worse than another in every objective
        print(dict(zip(OBJECTIVES, trial.values, strict=True)), trial.params)


if __name__ == "__main__":
    main()
