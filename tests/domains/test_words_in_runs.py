"""Runs in a domain whose keys are words: what is read back from text has the same meaning."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import islandgp
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits
from islandgp.evaluation.base import Job, Problem, simulate
from islandgp.evolution.loop import evolve
from islandgp.experiment import Experiment
from islandgp.gp.edits import Edit, edited
from islandgp.gp.record import RunState, Step
from islandgp.records.checkpoint import read_checkpoint, save_state
from islandgp.records.folder import RunFolder
from islandgp.running.parts import make_evaluator, make_search
from islandgp.viewer.run_page import champion_replay
from tests.domains.courier import SCHEMA
from tests.evolution.runs import Constant, lines

VOCABULARY = SCHEMA.vocabulary
WORKS = (
    "selector { when place == depot and hands == empty { Load }"
    " when place == house and hands == parcel { Unload }"
    " when place != road { Drive(to: road) }"
    " when hands == empty { Drive(to: depot) } Drive(to: house) }"
)
CONFIG = """
# @package _global_
domain: {factory: "tests.domains.courier:Courier"}
world: {ticks: 40}
rewards:
  events:
    loaded: {component: parcels, per_unit: 1}
    delivered: {component: parcels, per_unit: 5}
curriculum: {generations_per_epoch: 5, stages: [{epochs: [1, 1], multipliers: {}}]}
classes:
  behaviours: {loading: loaded, delivering: delivered}
  specialists: {of: [loading, delivering], dominance_ratio: 2.0, idle: idle, mixed: mixed}
  tiers: {delivering: {at_least: {delivered: 1}}}
  milestones: [delivering]
library: {folder: null}
name: courier
"""
SMALL = (
    "domain=courier",
    "gp.population=12",
    "gp.generations=6",
    "tracking=off",
    "progress=off",
    "evaluator=serial",
)


@pytest.fixture
def conf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of configuration with the domain; runs are written beside it."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "conf"
    (folder / "domain").mkdir(parents=True)
    (folder / "domain" / "courier.yaml").write_text(CONFIG.lstrip(), encoding="utf-8")
    return folder


def steps(experiment: Experiment, start: RunState | None = None) -> list[Step]:
    """A run whose supervisor sets the mutation rate alone."""
    settings, plan = experiment.settings, experiment.plan
    search = make_search(settings, plan)
    return list(
        evolve(plan, 1, Constant(0.8), make_evaluator(settings), search=search, start=start)
    )


@pytest.mark.parametrize("search", ["racing", "paper", "map_elites"])
def test_a_resumed_run_is_the_straight_one(conf: Path, search: str) -> None:
    """A checkpoint has trees as texts; without the vocabulary their words would be keys."""
    overrides = (*SMALL, f"search={search}", "supervisor=baseline")
    straight = steps(experiment := islandgp.compose(*overrides, config_dir=conf))
    assert any("==" in i.tree for step in straight for i in step.record.individuals)
    for at in (0, 2, 4):
        state = straight[at].state
        assert state is not None
        save_state(file := conf / "checkpoint.json", state)
        start = replace(read_checkpoint(file)[0], history=state.history)
        assert list(lines(steps(experiment, start))) == list(lines(straight[at + 1 :]))


@pytest.mark.slow
@pytest.mark.parametrize("supervisor", ["expert", "editor"])
def test_supervised_runs_end_with_a_robot_that_delivers(conf: Path, supervisor: str) -> None:
    """Injected trees, edits and the replay of the best robot compare words as the run does."""
    results = islandgp.run(*SMALL, f"supervisor={supervisor}", config_dir=conf)
    (row,) = results.runs.to_dict("records")
    assert row["validation_mean"] > 0
    folder = RunFolder(results.path / str(row["run"]))
    assert "<html" in champion_replay(folder, Problem.recorded(folder.configuration()))


def test_an_episode_of_a_text_is_that_of_its_tree(conf: Path) -> None:
    """Some jobs have a tree, others its text alone."""
    problem = islandgp.compose(*SMALL, config_dir=conf).settings.problem()
    tree = parse(WORKS, VOCABULARY)
    outcomes = [simulate(problem, Job(to_text(tree), 0, 1, node)) for node in (tree, None)]
    assert outcomes[0] == outcomes[1]
    assert outcomes[0].counters["delivered"] > 5


def test_an_edit_may_name_a_subtree_by_its_text() -> None:
    """The words of the place and of the branch are those of the tree."""
    branch = parse("when before == house { Drive(to: house) }", VOCABULARY)
    at = "when place == house and hands == parcel { Unload }"
    edit = Edit("replace", "0.0", at, branch)
    assert edit.branch == branch
    changed = edited(edit, {"0.0": parse(WORKS, VOCABULARY)}, VOCABULARY, Limits(9, 99))
    assert "when before == house { Drive(to: house) }" in to_text(changed)
    assert "Unload" not in to_text(changed)


def test_a_domain_of_numpy_values_runs(conf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Records, the page of the run and its replay have plain numbers."""
    file = conf / "domain" / "courier.yaml"
    text = file.read_text(encoding="utf-8").replace("courier:Courier", "numpy_courier:NumpyCourier")
    file.write_text(text, encoding="utf-8")
    experiment = islandgp.compose(*SMALL, "gp.generations=2", config_dir=conf)
    assert len(experiment.run().individuals) == 24
    assert "no replay" not in capsys.readouterr().err
    [outcome] = experiment.evaluate(WORKS, worlds=[0])
    numbers = [*outcome.components.values(), *outcome.counters.values(), outcome.seconds]
    assert {*map(type, numbers)} == {float}
    assert outcome.components["parcels"] > 6
