"""Searches: Hydra's sweepers that choose the jobs themselves."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn
from hydra.plugins.sweeper import Sweeper
from omegaconf import DictConfig

from islandgp.config.compose import Planned, Searched
from islandgp.errors import ConfigError, RunError
from islandgp.records.files import objectives, values
from islandgp.records.folder import RunFolder, Status
from islandgp.running.app import main
from islandgp.sweep.folder import SweepFile, SweepFolder
from islandgp.sweep.optimiser import best_lines, check
from islandgp.sweep.progress import job_line
from tests.composed import composed
from tests.running.commands import TINY, fake
from tests.running.histories import store, tracked

INSTANT = (*TINY, "tracking=off", "progress=off", *fake("Instant"))
OPTUNA = ("hydra/sweeper=optuna", "-m")


@pytest.fixture
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def file_in(folder: Path) -> SweepFile:
    """The file of a sweep's folder: its command and jobs."""
    file = SweepFolder(folder).read()
    assert file is not None
    return file


def results(folder: Path) -> dict[str, Any]:
    """The results of the search."""
    content: dict[str, Any] = yaml.safe_load((folder / "optimization_results.yaml").read_bytes())
    return content


def test_two_keys_of_the_smoke_experiment_are_tuned_in_three_trials(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Optuna chooses them, and the best run's validated mean is what it finds."""
    overrides = ["experiment=smoke", "supervisor=baseline", "tracking=off", "progress=off"]
    overrides += ["gp.population=6", "gp.generations=3"]
    overrides.append(
        "gp.trees.kinds.parallel=0.5"
    )  # fewer: with made-up outcomes they do everything
    space = ["gp.mutation_rate=interval(0.05,0.9)", "gp.tournament_size=range(2,6)"]
    trials = "hydra.sweeper.n_trials=3"
    assert main([*overrides, *fake("Instant"), *space, trials, *OPTUNA]) == 0
    file = file_in(cwd / "runs/smoke")
    assert len(file.jobs) == 3
    runs = [RunFolder(cwd / "runs/smoke" / job.folder) for job in file.jobs]
    for run in runs:
        gp = run.configuration()["gp"]
        assert 0.05 <= gp["mutation_rate"] <= 0.9
        assert gp["tournament_size"] in range(2, 6)
    result = results(cwd / "runs/smoke")
    means = [run.summary()["champion"]["validation"]["mean"] for run in runs]
    assert result["best_value"] == max(means)
    best = runs[means.index(max(means))].configuration()["gp"]
    assert result["best_params"] == {
        f"gp.{k}": best[k] for k in ("mutation_rate", "tournament_size")
    }
    output = capsys.readouterr().out
    rate = best["mutation_rate"]
    assert f"\nBest:\n  validation_mean {max(means):,.6g} with gp.mutation_rate={rate}" in output
    assert "Search: 3 different runs, 0 pruned, 0 failed" in output


def test_the_same_command_goes_on_with_a_search(cwd: Path) -> None:
    """Finished trials are taken as they are, and more trials are added to them."""
    overrides = [*INSTANT, "gp.mutation_rate=interval(0.05,0.9)", *OPTUNA]
    assert main([*overrides, "hydra.sweeper.n_trials=1"]) == 0
    before = {file: file.stat().st_mtime_ns for file in cwd.rglob("summary.json")}
    assert main([*overrides, "hydra.sweeper.n_trials=2"]) == 0
    after = {file: file.stat().st_mtime_ns for file in cwd.rglob("summary.json")}
    assert len(before) == 1
    assert len(after) == 2
    assert after.items() >= before.items()


@pytest.mark.slow
@pytest.mark.usefixtures("cwd")
def test_a_search_that_goes_on_judges_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its finished trials are followed generation by generation, though they do not run again."""
    judged: list[tuple[int, int, float]] = []

    def judge(trial: Any, generation: int, best: float) -> bool:
        judged.append((trial.number, generation, best))
        return False

    monkeypatch.setattr("islandgp.sweep.optuna_trials._judge", judge)
    overrides = [*INSTANT, "gp.mutation_rate=0.1,0.2", "hydra/sweeper/pruner=halving", *OPTUNA]
    assert main([*overrides, "hydra.sweeper.n_trials=2"]) == 0
    before = judged.copy()
    judged.clear()
    assert main([*overrides, "hydra.sweeper.n_trials=2"]) == 0
    assert judged == before != []


@pytest.mark.slow
def test_more_than_one_objective(cwd: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`objectives` names them, and the solutions are those that no other one is better than."""
    overrides = [*INSTANT, "seed=range(4)", "objectives=[validation_mean,first.excellent]", *OPTUNA]
    direction = "hydra.sweeper.direction=[maximize,minimize]"
    assert main([*overrides, direction, "hydra.sweeper.n_trials=4"]) == 0
    names = ("validation_mean", "first.excellent")
    folders = [RunFolder(file.parent) for file in cwd.rglob("summary.json")]
    points = {objectives(folder.summary(), names) for folder in folders}
    front = {p for p in points if not any(o != p and o[0] >= p[0] and o[1] <= p[1] for o in points)}
    assert {tuple(s["values"]) for s in results(cwd / "runs/default")["solutions"]} == front
    assert "None of these is worse than another one in every objective:" in capsys.readouterr().out


def test_results_of_other_sweepers_are_shown_as_they_are() -> None:
    """Each has its own keys: these are Nevergrad's."""
    found = {"name": "nevergrad", "best_evaluated_params": {"gp.population": 8}}
    expected = "Best:\n  name: nevergrad\n  best_evaluated_params:\n    gp.population: 8"
    assert best_lines(found, ["validation_mean"]) == expected


def test_a_robot_that_never_came_came_after_the_end() -> None:
    """An objective is a number in every run."""
    champion = {"record": {"fitness": 1.0}, "validation": {"mean": 2.0}}
    numbers = dict.fromkeys(("final_best", "final_mean", "mean_diversity", "seconds"), 0.5)
    summary = {
        **numbers,
        "champion": champion,
        "fittest": {"record": {"fitness": 4.0}},
        "generations": 7,
        "first": {"a": None, "b": 3},
    }
    names = ("validation_mean", "champion_fitness", "fitness_max", "first.a", "first.b")
    assert objectives(summary, names) == (2, 1, 4, 7, 3)
    assert values(summary)["first.a"] is None
    unvalidated = {**summary, "champion": {**champion, "validation": None}}
    assert values(unvalidated)["validation_mean"] is None
    assert objectives(unvalidated, ("fitness_max",)) == (4,)
    with pytest.raises(RunError, match=r"^objectives: expected a run with a validation_mean"):
        objectives(unvalidated, names)


@pytest.mark.slow
def test_pruned_trials_are_marked(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the sweep's file, on the terminal and in MLflow; they are no failures."""
    monkeypatch.chdir(home)
    space = ["world.episode.length=interval(40,400)", "hydra.sweeper.n_trials=5"]
    overrides = [*TINY, "progress=off", *fake("Lasting"), *space]  # no two trials are equally good
    pruner = ["hydra/sweeper/pruner=median", "hydra.sweeper.pruner.n_warmup_steps=1"]
    pruner += ["hydra.sweeper.pruner.n_startup_trials=1"]
    assert main([*overrides, *pruner, *OPTUNA]) == 0
    file = file_in(home / "runs/default")
    pruned = [job for job in file.jobs if job.pruned is not None]
    assert 0 < len(pruned) < len(file.jobs)
    runs = {run.name: run for run in tracked(store(home))}
    for job in pruned:
        folder = SweepFolder(home / "runs/default").run(job)
        assert folder.status() is Status.KILLED
        assert len(list(folder.records())) == job.pruned + 1  # type: ignore[operator]  # not None
        assert job_line(folder) == f"{job.folder}: pruned in generation {job.pruned}"
        assert runs[job.folder].status == "KILLED"
        assert runs[job.folder].tags["pruned"] == f"generation {job.pruned}"
    assert "pruned" not in next(r for r in runs.values() if r.status == "FINISHED").tags
    assert runs["sweep default"].status == "FINISHED"
    command = [*overrides, *pruner, *OPTUNA]
    assert main(command) == 0  # judged as before, from their records
    now = file_in(home / "runs/default")
    assert [(j.slot, j.pruned) for j in now.jobs] == [(j.slot, j.pruned) for j in file.jobs]


@pytest.mark.slow
def test_a_trial_whose_values_do_not_fit_together_fails_alone(
    cwd: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is reported like any failed job; the others continue."""
    space = ["gp.population=int(interval(4,12))", "gp.tournament_size=int(interval(2,11))"]
    overrides = [*INSTANT, *space, "hydra.sweeper.n_trials=4"]
    assert main([*overrides, *OPTUNA]) == 1
    captured = capsys.readouterr()
    file = file_in(cwd / "runs/default")
    failed = [
        job
        for job in file.jobs
        if not (cwd / "runs/default" / job.folder / "summary.json").exists()
    ]
    assert 0 < len(failed) < len(file.jobs)
    assert f"{len(failed)} of {len(file.jobs)} jobs not finished" in captured.err
    assert "gp.tournament_size: expected at most gp.population = " in captured.err
    assert f"{len(failed)} failed" in captured.out
    assert "Traceback" not in captured.err


@pytest.mark.slow
def test_trials_side_by_side_are_launched_together(cwd: Path) -> None:
    """Two equal ones are one run."""
    space = ["gp.tournament_size=2,3", "hydra.sweeper.n_trials=3", "hydra.sweeper.n_jobs=3"]
    assert main([*INSTANT, *space, *OPTUNA]) == 0
    file = file_in(cwd / "runs/default")
    assert sorted(job.choices[-1] for job in file.jobs) == [
        "gp.tournament_size=2",
        "gp.tournament_size=3",
    ]


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (["gp.mutation_rate=interval(0.1,1.9)"], "gp.mutation_rate=1.9: input should be less"),
        (
            ["gp.tournament_size=2,3", "hydra.sweeper.n_trails=9"],
            "did you mean hydra.sweeper.n_trials?",
        ),
        (
            ["gp.tournament_size=2,3", "+hydra.sweeper.sampler.sed=3"],
            "unexpected keyword argument 'sed'",
        ),
        (["gp.tournament_size=2,3", "name=a,b"], "expected one name for all trials"),
    ],
)
def test_a_search_that_cannot_be_is_refused(
    cwd: Path, capsys: pytest.CaptureFixture[str], overrides: list[str], expected: str
) -> None:
    """In one line, before anything runs."""
    assert main([*INSTANT, *overrides, *OPTUNA]) == 2
    errors = capsys.readouterr().err
    assert expected in errors
    assert "Traceback" not in errors
    assert not list(cwd.rglob("about.json"))


SWEEPER: dict[str, Any] = {
    "_target_": "hydra_plugins.islandgp_optuna.OptunaSweeper",
    "n_trials": 2,
    "n_jobs": 1,
    "direction": "maximize",
    "params": {},
    "sampler": {"_target_": "optuna.samplers.TPESampler"},
    "pruner": {},
}
MEDIAN = {"_target_": "optuna.pruners.MedianPruner"}
TWO = ("validation_mean", "fitness_max")


@pytest.mark.parametrize(
    ("sweep", "changes", "aims", "launcher", "expected"),
    [
        ("gp.tournament_size=2,3", {"n_trials": 0}, (), "", "n_trials=0: input should be greater"),
        ("gp.tournament_size=2,3", {"direction": "up"}, (), "", "'minimize' or 'maximize'"),
        ("gp.tournament_size=2,3", {}, TWO, "", "for each of the 2 objectives"),
        (
            "gp.tournament_size=2,3",
            {"sampler": {"_target_": "os.system"}},
            (),
            "",
            "optuna.samplers",
        ),
        ("gp.tournament_size=2,3", {"pruner": MEDIAN}, (), "JoblibLauncher", "1, 1 and JoblibLaun"),
        ("gp.tournament_size=2,3", {"pruner": MEDIAN, "n_jobs": 2}, (), "", "found 1, 2 and Basic"),
        ("gp.mutation_rate=0.3", {}, (), "", "found no sweep"),
        ("gp.mutation_rate=interval(0.9,0.1)", {}, (), "", "`low <= high`"),
        (
            "gp.tournament_size=interval(2,5)",
            {},
            (),
            "",
            r"write 'gp.tournament_size=int\(interval\(2,5\)\)'",
        ),
    ],
)
def test_what_optuna_cannot_do_is_refused(
    sweep: str, changes: dict[str, Any], aims: tuple[str, ...], launcher: str, expected: str
) -> None:
    """With what was expected, what was found, and what to write."""
    override = OverridesParser.create().parse_override(sweep)
    settings = composed().model_copy(update={"objectives": aims or ("validation_mean",)})
    job = Planned((), {}, settings, Path("/h"), "", launcher or "BasicLauncher")
    sweeps = (override,) if override.is_sweep_override() else ()
    with pytest.raises(ConfigError, match=expected):
        check(Searched(SWEEPER | changes, sweeps, (job, job), ()))


def test_names_of_objectives_are_checked() -> None:
    """They are columns of `islandgp.load`; names of older configurations are translated."""
    settings = composed("objectives=[best,final_mean]", "gp.validation=0")
    assert settings.objectives == ("validation_mean", "final_fitness_mean")
    with pytest.raises(ConfigError, match="objectives: expected names among champion_fitness, fi"):
        composed("objectives=[bast]")
    override = OverridesParser.create().parse_override("gp.tournament_size=2,3")
    job = Planned((), {}, settings, Path("/h"), "", "BasicLauncher")
    searched = Searched(SWEEPER | {"direction": ["maximize"] * 2}, (override,), (job, job), ())
    with pytest.raises(ConfigError, match=r"set gp\.validation above 0"):
        check(searched)


def test_an_interval_without_a_search_names_the_remedy(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Hydra's own sweeper runs combinations of values."""
    assert main([*INSTANT, "gp.mutation_rate=interval(0.1,0.3)", "-m"]) == 2
    assert "or search it with hydra/sweeper=optuna." in capsys.readouterr().err


class Twice(Sweeper):
    """A sweeper of another package: two jobs, one after the other."""

    returned_values: ClassVar[list[Any]] = []  # what the jobs returned

    def __init__(self, **_: Any) -> None: ...

    def setup(self, *, hydra_context: Any, task_function: Any, config: DictConfig) -> None:
        """See `Sweeper`."""
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """See `Sweeper`."""
        assert self.launcher is not None
        for n in range(2):
            returned: list[JobReturn] = list(
                self.launcher.launch([[*arguments, f"seed={n}"]], initial_job_idx=n)
            )
            self.returned_values.append(returned[0].return_value)


Twice.__module__ = "hydra_plugins.twice"  # Hydra takes sweepers from there only


@pytest.fixture
def twice(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """The sweeper, known to Hydra, and what its jobs returned."""
    module = ModuleType("hydra_plugins.twice")
    module.Twice = Twice  # type: ignore[attr-defined] # made here
    monkeypatch.setitem(sys.modules, module.__name__, module)
    Plugins.instance().register(Twice)
    Twice.returned_values.clear()
    yield Twice.returned_values
    del Plugins.instance().class_name_to_class["hydra_plugins.twice.Twice"]


@pytest.mark.slow
def test_the_program_returns_its_score_to_any_sweeper(cwd: Path, twice: list[Any]) -> None:
    """The validated champion's mean: what other plug-ins of Hydra's need."""
    assert main([*INSTANT, "hydra.sweeper._target_=hydra_plugins.twice.Twice", "-m"]) == 0
    folders = [
        RunFolder(cwd / "runs/default" / job.folder) for job in file_in(cwd / "runs/default").jobs
    ]
    assert twice == [values(f.summary())["validation_mean"] for f in folders]
    assert len(json.loads((cwd / "runs/default/sweep.json").read_text())["jobs"]) == 2
