"""What a user asks of a sweep: a file, an early end, two folders, a deletion."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import shutil
from pathlib import Path

import optuna
import pytest
import yaml
from click.testing import CliRunner, Result

import islandgp
from islandgp.cli import islandgp as group
from islandgp.config.compose import planned
from islandgp.config.reads import must_be_read
from islandgp.config.sources import ConfigSource
from islandgp.plain import flatten
from islandgp.resources import resource
from islandgp.running.app import main, parsed_argv
from islandgp.tracking.store import Store
from tests.composed import plain
from tests.running.commands import ROOT, TINY, fake
from tests.tracking.folders import place

INSTANT = (*TINY, *fake("Instant"), "gp.generations=2", "gp.validation=0", "prune.episodes=0")
QUIET = (*INSTANT, "tracking=off", "progress=off")


@pytest.fixture(autouse=True)
def cwd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def command(*words: str, answer: str = "") -> Result:
    """The result of an islandgp command."""
    return CliRunner().invoke(group, words, input=answer)


def test_a_sweep_in_a_file(cwd: Path) -> None:
    """A file with hydra.mode and hydra.sweeper.params is a sweep without -m; one override is added.

    Its factors are columns, and its arms are named by them.
    """
    (cwd / "conf/experiment").mkdir(parents=True)
    (cwd / "conf/experiment/mine.yaml").write_text(
        "# @package _global_\nname: mine\nhydra:\n  mode: MULTIRUN\n  sweeper:\n    params:\n"
        "      rewards.events.interaction.base: 100,1000\n      curriculum: last,flat\n"
    )
    assert main(["--config-dir", "conf", "experiment=mine", *QUIET, "seed=3"]) == 0
    runs = islandgp.load("runs/mine").runs
    assert len(runs) == 4
    assert {*runs["seed"]} == {3}
    factors = runs[["factor.curriculum", "factor.rewards.events.interaction.base"]]
    assert len(factors.drop_duplicates()) == 4
    assert "curriculum=flat interaction.base=100" in {*runs["arm"]}


@pytest.mark.slow
def test_two_folders_are_compared_as_one_sweep() -> None:
    """Seeds that were run elsewhere join the arms; a run is taken once."""
    for folder, seeds in (("a", "0,1"), ("b c", "2,3")):
        words = [*QUIET, "gp.generations=4", f"runs='{folder}'", f"seed={seeds}"]
        assert main([*words, "search=paper,nsga2", "-m"]) == 0
    for words in (["--runs", "a", "b c"], ["a", "b c"], ["--runs", "a", "--runs", "b c"]):
        result = command("compare", *words, "--worlds", "0", "-o", "out")
        assert result.exit_code == 0, result.output
        assert "search=nsga2 (4 runs, seeds 0-3)" in result.output
    twice = command("compare", "a", "a/default", "--worlds", "0")
    assert "search=nsga2 (2 runs, seeds 0-1)" in twice.output


@pytest.mark.slow
def test_a_deleted_run_is_gone_on_disk_and_in_mlflow(cwd: Path) -> None:
    """After a question; the sweep forgets it, and the same command runs it again."""
    sweep = [*INSTANT, "progress=off", "seed=0,1", "tracking.policy.patience=60", "-m"]
    assert main(sweep) == 0
    first, second = sorted(path.parent for path in cwd.glob("runs/default/*/about.json"))
    store = Store(place(cwd))

    def children() -> list[str]:
        names = [str(run.info.run_name) for run in store.client.search_runs([store.experiment])]
        return sorted(name for name in names if not name.startswith("sweep "))

    assert children() == [first.name, second.name]
    assert command("delete", str(first), answer="n\n").exit_code == 1
    assert first.exists()
    result = command("delete", str(first), answer="y\n")
    assert result.exit_code == 0, result.output
    assert not first.exists()
    assert children() == [second.name]
    assert len(json.loads((cwd / "runs/default/sweep.json").read_text())["jobs"]) == 1
    assert main(sweep) == 0
    assert children() == [first.name, second.name]
    assert command("delete", "runs/default", "--yes").exit_code == 0
    assert not (cwd / "runs/default").exists()
    assert children() == []


@pytest.mark.slow
def test_a_job_that_is_repeated_replaces_its_mlflow_run(cwd: Path) -> None:
    """A folder that was deleted by hand and run again has one MLflow run, not two."""
    sweep = [*INSTANT, "progress=off", "seed=0,1", "tracking.policy.patience=60", "-m"]
    assert main(sweep) == 0
    shutil.rmtree(next(iter(cwd.glob("runs/default/*seed0*"))))
    assert main(sweep) == 0
    store = Store(place(cwd))
    names = [run.info.run_name for run in store.client.search_runs([store.experiment])]
    assert len(names) == len({*names}) == 3  # two jobs and the sweep


@pytest.mark.parametrize("path", ["runs", "empty folder", "file"])
def test_delete_takes_runs_only(cwd: Path, path: str) -> None:
    """Another folder stays as it is, with one line."""
    (cwd / "runs").mkdir()
    (cwd / "empty folder").mkdir()
    (cwd / "file").touch()
    assert command("delete", path, "--yes").exit_code != 0
    assert (cwd / path).exists()


def plain_choices() -> dict[str, str | None]:
    """The options that are chosen without overrides."""
    composed = ConfigSource("config", None).compose([])
    return {str(k): v for k, v in composed.hydra.runtime.choices.items()}


def test_the_help_has_the_most_used_keys_with_their_defaults(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """At 80 columns; each key has the default that a run without overrides has."""
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    source, choices = ConfigSource("config", None), plain_choices()
    words = "\n".join(lines)
    for name in source.loader().list_groups(""):
        options = {file.stem for file in (resource("conf") / name).glob("*.yaml")}
        if name != "hydra" and options:
            listed = re.findall(rf"^{name} +(\w+(?:,\s+\w+)*):\s", words, re.MULTILINE)
            assert listed, name
            names = re.split(r",\s+", listed[0])
            assert {*names} == options, name
            assert choices.get(name) in (None, "None", names[0]), name
    first = lines.index("The most used keys, as KEY=VALUE, with their defaults:") + 2
    last = lines.index("", first)
    config = flatten(plain())
    for line in lines[first:last]:
        key, default, *_ = line.split()
        assert yaml.safe_load(default) == config[key], key
    assert last - first == 20


@pytest.mark.parametrize("key", ["rewards.events.interaction.base", "world.episode.length"])
def test_a_search_over_what_its_objective_is_in_is_refused(key: str) -> None:
    """Before the first run; diversity is no objective in points."""
    names = runpy.run_path(str(ROOT / "examples/optuna_search.py"))
    trial = optuna.trial.FixedTrial({})
    names["objective"].__globals__["space"] = lambda _: [f"{key}=7"]
    with pytest.raises(SystemExit, match=f"an objective that {key} does not define, found valid"):
        names["objective"](trial, [*QUIET])
    names["OBJECTIVES"].clear()
    names["OBJECTIVES"]["mean_diversity"] = "maximize"
    assert names["objective"](trial, [*QUIET, *fake("Instant")])[0] > 0


def test_the_documented_sweeps_vary_what_acts(cwd: Path) -> None:
    """Each command and the file of docs/sweeps.md, and the space of the Optuna example."""
    text = (ROOT / "docs/sweeps.md").read_text(encoding="utf-8")
    (file,) = re.findall(r"^```yaml\n# (\S+)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    (cwd / file[0]).parent.mkdir(parents=True)
    (cwd / file[0]).write_text(file[1])
    lines = re.findall(r"^(?:\$ )?python -m islandgp (.*)$", text, re.MULTILINE)
    assert len(lines) == 3
    for line in lines:
        args, argv = parsed_argv(shlex.split(line))
        jobs = list(planned(args, argv, cwd))
        must_be_read(jobs, ConfigSource.of(args))
        assert len(jobs) > 1, line
    names = runpy.run_path(str(ROOT / "examples/optuna_search.py"))
    values = {"gp.mutation_rate": 0.5, "gp.tournament_size": 3, "supervisor": "expert"}
    islandgp.compose("search=paper", *names["space"](optuna.trial.FixedTrial(values)))
