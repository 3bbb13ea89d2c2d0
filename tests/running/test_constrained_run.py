"""A run with constraints and perturbed worlds: its folder, its page and its reports."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree

import pytest
from click.testing import CliRunner

import islandgp
from islandgp.cli import islandgp as group
from islandgp.compare.arms import Arm, find
from islandgp.compare.champions import evaluate_champions
from islandgp.compare.comparable import compare_arms
from islandgp.compare.tables import arms_table, unseen_table
from islandgp.evaluation.serial import Serial
from islandgp.records.folder import RunFolder
from islandgp.records.values import generation_values, metric_values
from islandgp.running.report import report
from islandgp.scoring.constraints import recorded_constraints, violation
from tests.tracking.test_metrics import COST

OVERRIDES = (
    "experiment=smoke",
    "supervisor=baseline",
    "gp.population=12",
    "gp.generations=4",
    "gp.validation=1",
    "world.episode.length=40",
    "tracking=off",
    "progress=off",
    "evaluator=serial",
    "constraints={distance: {at_most: 200}, interactions: {at_most: 0}}",
    "perturb={world: {robot.speed: [8, 12]}, noise: 1, delay: 5}",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A finished run."""
    experiment = islandgp.compose(*OVERRIDES, f"runs={tmp_path_factory.mktemp('a run')}")
    experiment.run()
    return RunFolder(experiment.folder)


def test_the_best_robot_is_feasible_before_fit(folder: RunFolder) -> None:
    """In the summary, the report and the records; one that earns more breaks a limit."""
    summary, constraints = folder.summary(), recorded_constraints(folder.configuration())
    everyone = [i for record in folder.records() for i in record["individuals"]]
    ranking = {i["id"]: (-violation(i["counters"], constraints), i["fitness"]) for i in everyone}
    assert max(i["fitness"] for i in everyone) > summary["fittest"]["record"]["fitness"]
    assert ranking[summary["fittest"]["record"]["id"]] == max(ranking.values())
    for record in folder.records():
        best = max(record["individuals"], key=lambda i: ranking[i["id"]])
        assert record["snapshot"]["fitness_max"] == best["fitness"]
    assert summary["constraints"] == "distance at most 200, interactions at most 0"
    assert summary["champion"]["validation"]["violation"] == 0
    assert summary["champion"]["validation"]["feasible"] > 0
    assert "(distance at most 200, interactions at most 0): kept on average, and in" in report(
        folder, list(folder.costs())
    )


def test_frames(folder: RunFolder) -> None:
    """Violations of individuals and runs, and the shares of those who keep all limits."""
    results = islandgp.load(folder.path)
    individuals, generations, runs = results.individuals, results.generations, results.runs
    feasible = individuals["constraints.violation"] == 0
    shares = feasible.groupby(individuals["generation"]).mean()
    assert 0 < feasible.sum() < len(feasible)
    assert list(shares) == list(generations["constraints.feasible"])
    assert list(runs["constraints.violation"]) == [0]
    assert list(runs["constraints.feasible"]) == [
        folder.summary()["champion"]["validation"]["feasible"]
    ]


def test_metrics(folder: RunFolder) -> None:
    """The share of feasible individuals, and the components of the best one, not the fittest."""
    constraints = recorded_constraints(folder.configuration())
    for record in folder.records():
        values = metric_values(generation_values(record, COST, constraints))
        assert values["constraints/violation_of_best"] == 0
        assert 0 < values["constraints/feasible"] <= 1
        assert sum(v for k, v in values.items() if k.startswith("components/")) == pytest.approx(
            values["fitness_max"]
        )
        assert not any(name.startswith("constraints/") for name in generation_values(record, COST))


def test_the_page(folder: RunFolder) -> None:
    """Its sentence states whether the best robot keeps the constraints."""
    page = (folder.path / "run.html").read_text(encoding="utf-8")
    limits = "distance at most 200, interactions at most 0"
    assert f"Constraints ({limits}): kept on average, and in " in page
    assert "<dt>constraints</dt><dd>distance at most 200, interactions at most 0</dd>" in page


def test_the_archive_is_feasible(folder: RunFolder) -> None:
    """An elite's individual kept all limits."""
    constraints = recorded_constraints(folder.configuration())
    counters = {
        i["id"]: i["counters"] for record in folder.records() for i in record["individuals"]
    }
    elites = islandgp.load(folder.path).archive["id"]
    assert len(elites) > 0
    assert all(violation(counters[id_], constraints) == 0 for id_ in elites)


@pytest.mark.slow
def test_best(folder: RunFolder) -> None:
    """The share of worlds with all limits kept, and mean and worst of the perturbed worlds."""
    arguments = ["best", str(folder.path), "--worlds", "2", "--workers", "1"]
    rows = json.loads(CliRunner().invoke(group, [*arguments, "--json"]).output)
    assert rows[0]["feasible"] > 0
    assert all(row["perturbed_worst"] <= row["perturbed"] for row in rows)
    text = CliRunner().invoke(group, arguments).output
    assert "constraints kept" in text
    assert "perturbed" in text.splitlines()[0]


def test_compare(folder: RunFolder, tmp_path: Path) -> None:
    """A table of the constraints, and columns of the perturbed worlds."""
    other = tmp_path / "b"
    copytree(folder.path, other)
    arms = [Arm(name, "", tuple(find([path]))) for name, path in (("a", folder.path), ("b", other))]
    study = compare_arms(arms, force=True)
    feasible = folder.summary()["champion"]["validation"]["feasible"]
    assert list(study.runs["constraints.feasible"]) == [feasible] * 2
    frame = arms_table(study)
    assert frame["constraints"][0] == "distance at most 200, interactions at most 0"
    assert frame["kept in validation worlds"][0].endswith(" %")
    tested = evaluate_champions(study, Serial, worlds=2, trees={})
    columns = unseen_table(study, tested).columns
    assert {"perturbed (points)", "worst perturbed"} <= set(columns)


def test_an_unconstrained_run_has_no_figure_of_them(tmp_path: Path) -> None:
    """The summary has none; frames and page have no more than before."""
    experiment = islandgp.compose(*OVERRIDES[:-2], f"runs={tmp_path}")
    results = experiment.run()
    summary = RunFolder(experiment.folder).summary()
    validation = summary["champion"]["validation"]
    assert (summary["constraints"], validation["violation"], validation["feasible"]) == (None,) * 3
    for frame in (results.runs, results.generations, results.individuals):
        assert not any(name.startswith("constraints") for name in frame.columns)
    assert "constraints" not in (experiment.folder / "run.html").read_text(encoding="utf-8")
