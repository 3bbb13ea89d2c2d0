"""Sweeps under each launcher: the same records as one job after the other."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hydra._internal.utils import get_args_parser

from islandgp.config.compose import command_line, planned
from islandgp.evaluation.processes import cores
from islandgp.running.app import main
from islandgp.running.sweep import BASIC, jobs_at_once, kind_of
from tests.running.commands import ROOT, finish, group_members, start

pytestmark = pytest.mark.process

OVERRIDES = (
    "supervisor=baseline",
    "experiment=smoke",
    "gp.population=4",
    "gp.generations=2",
    "world.episode.length=20",
    "tracking=off",
    "progress=plain",
    "seed=0,1",
    "-m",
)


def records(home: Path) -> dict[str, bytes]:
    """Each run's records."""
    return {file.parent.name: file.read_bytes() for file in home.rglob("generations.jsonl")}


def alone(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs the sweep in this process, one job after the other."""
    home.mkdir()
    monkeypatch.chdir(home)
    assert main([*OVERRIDES, "evaluator=serial"]) == 0


def sweep(home: Path, *options: str) -> str:
    """Runs the sweep in a new folder; returns its output."""
    home.mkdir()
    process = start(home, *OVERRIDES, *options)
    code, output = finish(process, 300)
    assert code == 0, output
    if sys.platform == "linux":
        assert group_members(process.pid) == []
    return output


@pytest.mark.slow
def test_processes_give_the_same_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two jobs at a time, each in its own workers; one progress line for all."""
    alone(tmp_path / "basic", monkeypatch)
    output = sweep(tmp_path / "local", "hydra/launcher=local", "hydra.launcher.n_jobs=2")
    assert records(tmp_path / "local") == records(tmp_path / "basic")
    assert len(records(tmp_path / "basic")) == 2
    assert "2 of 2 jobs done: " in output
    assert "generation       best" not in output  # no job shows its own table


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "options"),
    [
        ("submitit", ["hydra/launcher=slurm_try"]),
        ("ray", ["evaluator=ray", "evaluator.policy.address=local", "evaluator.policy.workers=2"]),
    ],
)
def test_clusters_give_the_same_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, options: list[str]
) -> None:
    """Jobs as Slurm would start them, episodes on Ray."""
    pytest.importorskip(module)
    alone(tmp_path / "basic", monkeypatch)
    sweep(tmp_path / "other", *options)
    assert records(tmp_path / "other") == records(tmp_path / "basic")


@pytest.mark.slow
def test_a_job_whose_process_dies_is_repeated_by_the_same_command(tmp_path: Path) -> None:
    """The pool gives up when a worker is killed; the command lists the jobs, and finishes them."""
    flag = tmp_path / "flag"
    overrides = (
        "supervisor=baseline",
        "gp.population=8",
        "gp.generations=4",
        "tracking=off",
        "progress=plain",
        "evaluator=serial",
        "evaluator.factory=tests.running.evaluators:Breaks",
        f"++evaluator.policy={{after:2,how:kill,unless:'{flag}',mark:true}}",
        "seed=0,1,2",
        "hydra/launcher=local",
        "hydra.launcher.n_jobs=2",
        "-m",
    )
    code, output = finish(start(tmp_path, *overrides))
    assert code == 1, output
    assert "the launcher failed" in output
    assert "jobs not finished" in output
    assert finish(start(tmp_path, *overrides))[0] == 0
    assert len(records(tmp_path)) == 3


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["hydra/launcher=local", "hydra.launcher.n_jobs=0"], "hydra.launcher.n_jobs: expected 1"),
        (["hydra/launcher=slurm"], "Expected the launcher to start the jobs, found that it"),
        (["+hydra.launcher.n_jobs=2", "hydra.launcher._target_=a.B"], "hydra/launcher: expected"),
    ],
)
def test_a_launcher_that_cannot_start_is_reported_once(
    options: list[str],
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line with its reason, exit code 2; no job is blamed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", "")
    assert main([*OVERRIDES, "progress=off", *options]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"islandgp: {line}")
    assert captured.err.count("\n") == 1


def test_jobs_at_a_time_share_the_cores() -> None:
    """No oversubscription: jobs at a time x workers of each is at most the cores."""
    assert jobs_at_once({"_target_": BASIC}, 10) == 1
    assert jobs_at_once({"n_jobs": 3}, 10) == 3
    assert jobs_at_once({"n_jobs": -1}, 10 * cores()) == cores()
    assert jobs_at_once({"n_jobs": -1}, 1) == 1
    assert jobs_at_once({"cluster": "local"}, 4) == 4
    assert jobs_at_once({"cluster": "slurm"}, 10) == 1  # Slurm has shared them out


@pytest.mark.parametrize(
    ("name", "kind"), [("local", "processes"), ("slurm", "slurm"), ("slurm_try", "local")]
)
def test_each_launcher_has_a_configuration_that_composes(name: str, kind: str) -> None:
    """With it the command's job runs under the launcher that the file is for."""
    arguments = [f"hydra/launcher={name}", "-m"]
    (job,) = planned(get_args_parser().parse_args(arguments), arguments, ROOT)
    assert kind_of(job.launcher) == kind
    assert "launcher" not in job.folder.name


def test_commands_are_quoted_for_a_shell() -> None:
    """What is printed to run a job again can be pasted."""
    assert command_line(["seed=range(5)", "-m"]) == "python -m islandgp 'seed=range(5)' -m"
    assert command_line(["tracking.policy.uri=http://me:word@host"]) == (
        "python -m islandgp 'tracking.policy.uri=http://***@host'"
    )
