"""Runs and sweeps that are killed, and started again with the same command."""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.running.commands import (
    TINY,
    fake,
    finish,
    group_members,
    kill_group,
    lines,
    start,
    wait_until,
    workers,
)
from tests.running.histories import store, tracked

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc"),
]

SLOW = (*TINY, "gp.generations=12", "gp.validation=0", *fake("Slow", seconds=0.2))
SHORT = (*TINY, "gp.generations=4", "gp.validation=0", *fake("Slow", seconds=0.2))


def same_run(one: Path, other: Path, name: str) -> None:
    """Asserts that two runs left the same records and the same MLflow history."""
    for file in ("generations.jsonl", "best.bt", "lineage.csv", "config.yaml"):
        assert (one / "runs" / name / file).read_bytes() == (
            other / "runs" / name / file
        ).read_bytes(), file
    (a,), (b,) = tracked(store(one)), tracked(store(other))
    assert a.points == b.points
    assert (a.name, a.status, a.params, a.artifacts) == (b.name, b.status, b.params, b.artifacts)
    assert a.status == "FINISHED"


@pytest.mark.slow
def test_a_run_killed_three_times_ends_like_one_that_was_not(tmp_path: Path) -> None:
    """`kill -9` of the group after generations 2, 5 and 9; records, tree, history are equal."""
    straight, killed = tmp_path / "whole", tmp_path / "killed"
    for home in (straight, killed):
        home.mkdir()
    undisturbed = start(straight, *SLOW)
    name = "baseline-seed0-gp.generations=12-gp.population=8-gp.validation=0"
    records = killed / "runs/default" / name
    for generations in (2, 5, 9):
        process = start(killed, *SLOW)
        wait_until(lambda: lines(records / "generations.jsonl") >= generations, process)  # noqa: B023 -- called at once
        kill_group(process)
    assert not (records / "summary.json").exists()
    code, output = finish(start(killed, *SLOW))
    assert code == 0, output
    assert finish(undisturbed)[0] == 0
    same_run(straight, killed, f"default/{name}")


@pytest.mark.slow
def test_a_run_killed_at_twenty_random_moments_ends_like_one_that_was_not(tmp_path: Path) -> None:
    """Real episodes in a pool; moments from start-up to the sending of records."""
    overrides = (
        "supervisor=expert",
        "gp.population=12",
        "gp.generations=800",
        "evaluator.policy.workers=2",
        "progress=off",
        "name=k",
    )
    straight, killed = tmp_path / "whole", tmp_path / "killed"
    for home in (straight, killed):
        home.mkdir()
    assert finish(start(straight, *overrides), 600)[0] == 0
    name = next(path.name for path in (straight / "runs/k").iterdir() if path.is_dir())
    moments, kills = random.Random(20), 0
    records = killed / "runs/k" / name / "generations.jsonl"
    while kills < 20:
        process = start(killed, *overrides)
        target = lines(records) + moments.choice((0, 1, 1, 2, 3))
        wait_until(lambda: lines(records) >= target, process)  # noqa: B023 -- called at once
        time.sleep(moments.uniform(0, 0.4) if moments.random() < 0.8 else moments.uniform(1, 4))
        assert process.poll() is None, "it ended before it was killed twenty times"
        kill_group(process)
        kills += 1
    code, output = finish(start(killed, *overrides), 600)
    assert code == 0, output
    same_run(straight, killed, f"k/{name}")


TWO_WORKERS = ("evaluator=processes", "evaluator.policy.workers=2")


def assert_all_end(group: int) -> None:
    """Asserts that no process of a group is left after a while."""
    end = time.monotonic() + 20
    while (members := group_members(group)) and time.monotonic() < end:
        time.sleep(0.05)
    assert members == []


def test_workers_end_when_their_run_is_killed(tmp_path: Path) -> None:
    """`kill -9` of the run's process alone leaves no worker behind."""
    process = start(
        tmp_path, "experiment=smoke", "tracking=off", "evaluator.policy.workers=2", "progress=plain"
    )
    wait_until(lambda: any(tmp_path.rglob("checkpoint.json")), process)
    assert len(group_members(process.pid)) > 2
    process.kill()
    process.communicate()
    assert_all_end(process.pid)


def test_ctrl_c_stops_a_run_and_the_same_command_finishes_it(tmp_path: Path) -> None:
    """Exit code 130, no process left, run KILLED; then FINISHED, in the same MLflow run."""
    process = start(tmp_path, *SHORT)
    wait_until(lambda: any(tmp_path.rglob("checkpoint.json")), process)
    process.send_signal(signal.SIGINT)
    code, output = finish(process)
    assert code == 130, output
    assert "Traceback" not in output
    assert group_members(process.pid) == []
    (stopped,) = tracked(store(tmp_path))
    assert stopped.status == "KILLED"
    code, output = finish(start(tmp_path, *SHORT))
    assert code == 0, output
    (finished,) = tracked(store(tmp_path))
    assert (finished.id, finished.status) == (stopped.id, "FINISHED")
    assert finished.points["fitness_max"][0][0] == 0
    assert [step for step, _ in finished.points["fitness_max"]] == list(range(4))


def test_ctrl_c_while_modules_are_imported(tmp_path: Path) -> None:
    """Exit code 130 and a line, also from a library that would swallow an exception."""
    (tmp_path / "hydra.py").write_text(
        "import os, signal\ntry:\n    os.kill(os.getpid(), signal.SIGINT)\n    open(os.devnull)\n"
        "except BaseException:\n    raise ImportError('cannot be imported') from None\n"
    )
    assert finish(start(tmp_path, *SLOW)) == (130, "islandgp: stopped\n")


@pytest.mark.parametrize(
    "killed",
    [
        pytest.param(False, id="one stopped"),
        pytest.param(True, id="another one killed as well", marks=pytest.mark.slow),
    ],
)
def test_a_run_stops_in_seconds_although_a_worker_does_not_answer(
    killed: bool, tmp_path: Path
) -> None:
    """A stopped worker (SIGSTOP) cannot end by itself; it is killed, and nothing is left.

    SIGTERM, as clusters send it, ends the run as Ctrl-C does.
    """
    process = start(tmp_path, *TINY, "gp.generations=5000", "tracking=off", *TWO_WORKERS)
    wait_until(lambda: any(tmp_path.rglob("checkpoint.json")), process)
    one, other = workers(process)
    os.kill(one, signal.SIGSTOP)
    if killed:
        os.kill(other, signal.SIGKILL)
        time.sleep(0.5)
    process.terminate()
    code, output = finish(process, 60)
    assert code == 130, output
    assert "the same command continues the run" in output
    assert_all_end(process.pid)


@pytest.mark.slow
def test_ctrl_c_stops_a_parallel_sweep_and_the_same_command_finishes_it(tmp_path: Path) -> None:
    """No process left, nothing RUNNING, exit code 130; then all jobs and the parent FINISHED."""
    overrides = (*SLOW, "hydra/launcher=local", "hydra.launcher.n_jobs=2", "seed=range(3)", "-m")
    process = start(tmp_path, *overrides)
    wait_until(lambda: any(tmp_path.rglob("checkpoint.json")), process)

    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    code, output = finish(process)
    assert code == 130, output
    assert group_members(process.pid) == []
    runs = tracked(store(tmp_path))
    assert runs
    assert {run.status for run in runs} == {"KILLED"}
    code, output = finish(start(tmp_path, *overrides))
    assert code == 0, output
    runs = tracked(store(tmp_path))
    assert sorted(run.status for run in runs) == ["FINISHED"] * 4
    (parent,) = (run for run in runs if run.parent is None)
    assert {run.parent for run in runs if run is not parent} == {parent.id}


@pytest.mark.slow
def test_a_parallel_sweep_that_is_killed_leaves_no_worker(tmp_path: Path) -> None:
    """`kill -9` of its process alone: jobs, their workers and idle workers end with it."""
    launcher = ("hydra/launcher=local", "hydra.launcher.n_jobs=3", "seed=0,1", "-m")
    overrides = (*TINY, "gp.generations=60", "tracking=off", *TWO_WORKERS, *launcher)
    process = start(tmp_path, *overrides)
    wait_until(lambda: len(list(tmp_path.rglob("checkpoint.json"))) == 2, process)
    process.kill()
    process.wait()
    assert_all_end(process.pid)
    process.communicate()
    code, output = finish(start(tmp_path, *overrides))
    assert code == 0, output
    assert list(tmp_path.rglob("error.txt")) == []
