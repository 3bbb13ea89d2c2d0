"""`examples/optuna_search.py`: a search over configurations with Optuna."""

from __future__ import annotations

import re
import runpy
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.trial import TrialState

import islandgp
from islandgp.records.folder import RunFolder, Status
from tests.running.commands import ROOT, TINY, fake

SCRIPT = ROOT / "examples/optuna_search.py"
INSTANT = (*TINY[1:3], *fake("Instant"), "tracking=off")

pytestmark = pytest.mark.filterwarnings(
    "ignore::optuna.exceptions.ExperimentalWarning"  # of the heartbeat
)


@pytest.fixture(autouse=True)
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    return tmp_path


@pytest.fixture
def search() -> Callable[[int], optuna.Study]:
    """Searches until there are so many trials; returns the study."""
    names = runpy.run_path(str(SCRIPT))
    return lambda trials: names["search"](list(INSTANT), trials, "sqlite:///optuna.db", 1)


def runs() -> list[RunFolder]:
    """The folders of the search's runs."""
    return [RunFolder(file.parent) for file in Path("runs/optuna").glob("*/about.json")]


def test_the_documented_command_searches(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It prints the best trial; a second command with more trials keeps the first ones."""
    text = (ROOT / "docs/sweeps.md").read_text(encoding="utf-8")
    block = re.search(r"^```sh script\npython (.*)\n```", text, re.MULTILINE)
    assert block is not None
    words = [word for word in shlex.split(block[1]) if word not in ("--trials", "20")]
    assert ROOT / words[0] == SCRIPT
    printed = []
    for trials in ("2", "3"):
        monkeypatch.setattr(sys, "argv", [*words, *INSTANT, "--trials", trials])
        runpy.run_path(str(SCRIPT), run_name="__main__")
        printed.append(capsys.readouterr().out)
    assert all(re.match(r"\{'validation_mean': \d+.*\} \{'gp.mutation_rate': ", p) for p in printed)
    (summary,) = optuna.get_all_study_summaries("sqlite:///optuna.db")
    study = optuna.load_study(study_name=summary.study_name, storage="sqlite:///optuna.db")
    assert [trial.state for trial in study.trials] == [TrialState.COMPLETE] * 3
    means = islandgp.load("runs/optuna").runs["validation_mean"]
    assert sorted(means) == sorted(trial.value for trial in study.trials)


@pytest.mark.slow
def test_an_interrupted_trial_is_continued(
    search: Callable[[int], optuna.Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next command first ends its run, from the generation in which it was stopped."""
    monkeypatch.setattr(optuna.Trial, "should_prune", lambda trial: _interrupt(trial.number == 1))
    with pytest.raises(KeyboardInterrupt):
        search(2)
    (stopped,) = [run for run in runs() if run.status() is Status.KILLED]
    assert stopped.completed_generations() == 1
    study = search(2)
    assert stopped.finished()
    assert len(runs()) == 2
    assert [t.state for t in study.trials] == [
        TrialState.COMPLETE, TrialState.FAIL, TrialState.COMPLETE
    ]  # fmt: skip
    assert study.trials[2].params == study.trials[1].params
    assert len(study.trials[2].intermediate_values) == 6  # those before the stop, too


def _interrupt(now: bool) -> bool:
    if now:
        raise KeyboardInterrupt
    return False


def test_a_poor_trial_is_pruned(
    search: Callable[[int], optuna.Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its run ends without an error; the other trials go on."""
    monkeypatch.setattr(
        optuna.Trial, "should_prune", lambda trial: (trial.number, _last(trial)) == (0, 2)
    )
    study = search(2)
    assert [trial.state for trial in study.trials] == [TrialState.PRUNED, TrialState.COMPLETE]
    (pruned,) = [run for run in runs() if not run.finished()]
    assert pruned.status() is Status.KILLED
    assert not pruned.error()
    assert pruned.completed_generations() == 3


def _last(trial: optuna.Trial) -> int:
    frozen = trial.study.trials[trial.number]
    return max(frozen.intermediate_values)


@pytest.mark.slow
def test_a_search_with_two_objectives() -> None:
    """The best trials are those of the Pareto front."""
    names = runpy.run_path(str(SCRIPT))
    names["OBJECTIVES"]["mean_diversity"] = "maximize"
    study = names["search"](list(INSTANT), 4, "sqlite:///optuna.db", 1)
    rows = islandgp.load("runs/optuna").runs[["validation_mean", "mean_diversity"]]
    points = {tuple(map(float, row)) for row in rows.to_numpy()}
    front = {p for p in points if not any(o != p and min(_gain(p, o)) >= 0 for o in points)}
    assert {tuple(trial.values) for trial in study.best_trials} == front


def _gain(before: tuple[float, ...], after: tuple[float, ...]) -> list[float]:
    return [b - a for a, b in zip(before, after, strict=True)]


def test_values_that_do_not_fit_together_fail_alone(
    search: Callable[[int], optuna.Study], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search continues after a trial whose configuration is wrong."""
    suggest: Any = optuna.Trial.suggest_int
    monkeypatch.setattr(
        optuna.Trial,
        "suggest_int",
        lambda trial, *limits: 9 if trial.number == 0 else suggest(trial, *limits),
    )
    assert [trial.state for trial in search(2).trials] == [TrialState.FAIL, TrialState.COMPLETE]
