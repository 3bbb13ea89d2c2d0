"""What every evaluator promises: the outcomes of the jobs in their order, wherever they ran."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Timer
from types import SimpleNamespace
from typing import Any

import pytest

from islandgp.bt.core.node import leaf
from islandgp.domain import Outcome, Reward, RewardTable
from islandgp.errors import DomainError, EvaluationError
from islandgp.evaluation import processes
from islandgp.evaluation.base import Evaluator, Job, Problem, simulate
from islandgp.evaluation.processes import Processes
from islandgp.evaluation.serial import Serial
from islandgp.scoring.curriculum import Curriculum, Stage
from islandgp_ray.evaluator import Ray
from tests.domains.courier import Courier, World

pytestmark = pytest.mark.process

TREES = (
    "Drive(to: depot)",
    "sequence { Drive(to: depot) Load }",
    "selector { sequence { Drive(to: depot) Load } sequence { Drive(to: road) Unload } }",
)
JOBS = [Job(tree, stage, seed) for tree in TREES for stage in (0, 1) for seed in (0, 1)]

ROOT = Path(__file__).parents[2]


LOADING = Reward(component="parcels", per_unit=7)
SETTING = Problem(
    Courier(World(), RewardTable(events={"loaded": LOADING})),
    Curriculum(
        generations_per_epoch=1,
        stages=(
            Stage(epochs=(1, 1), multipliers={}),
            Stage(epochs=(2, 2), multipliers={"parcels": 3}),
        ),
    ),
)
EXPECTED = tuple(Serial(SETTING).evaluate(JOBS))
"""What the jobs come to, one after the other in this process."""


def ray(problem: Problem) -> Ray:
    """A cluster of two workers on this machine."""
    return Ray(Ray.Settings(address="local", cpus=1, retries=2, workers=2), problem)


MAKERS: dict[str, Callable[[], Evaluator]] = {
    "serial": lambda: Serial(SETTING),
    "processes": lambda: Processes(SETTING, 2),
    "ray": lambda: ray(SETTING),
}


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.slow if name == "ray" else ()) for name in MAKERS],
)
def evaluator(request: pytest.FixtureRequest) -> Iterator[Evaluator]:
    """Each evaluator in turn, which serves all tests of the interface."""
    if request.param == "ray":
        pytest.importorskip("ray")
    instance = MAKERS[request.param]()
    yield instance
    instance.close()


def test_outcomes_are_the_same_wherever_they_come_from(evaluator: Evaluator) -> None:
    """Number by number, in the order of the jobs, and again at the second call."""
    assert tuple(evaluator.evaluate(JOBS)) == EXPECTED
    assert tuple(evaluator.evaluate(JOBS[::-1])) == EXPECTED[::-1]


def test_no_jobs_give_no_outcomes(evaluator: Evaluator) -> None:
    """An empty batch is no error."""
    assert evaluator.evaluate([]) == []


def test_twins_have_one_outcome(evaluator: Evaluator) -> None:
    """The same job twice in a batch gives the same outcome twice."""
    assert evaluator.evaluate([JOBS[0], JOBS[5], JOBS[0]]) == [
        EXPECTED[0],
        EXPECTED[5],
        EXPECTED[0],
    ]


def test_a_job_that_cannot_be_run_is_named(evaluator: Evaluator) -> None:
    """The error names the world seed and the tree; the evaluator works afterwards."""
    bad = Job("NoSuchAction", 0, 77)
    with pytest.raises(EvaluationError, match=r"world seed 77[\s\S]*NoSuchAction"):
        evaluator.evaluate([JOBS[0], bad, JOBS[1]])
    assert evaluator.evaluate(JOBS[:2]) == list(EXPECTED[:2])


def test_jobs_may_be_made_one_by_one(evaluator: Evaluator) -> None:
    """An early evaluator takes a generator, also if the making of a job fails."""

    def failing() -> Iterator[Job]:
        yield JOBS[0]
        raise ArithmeticError

    if getattr(evaluator, "early", False):
        assert tuple(evaluator.evaluate(job for job in JOBS)) == EXPECTED
        with pytest.raises(ArithmeticError):
            evaluator.evaluate(failing())
        assert tuple(evaluator.evaluate(JOBS)) == EXPECTED


def kill_workers() -> None:
    """`kill -9` of all workers; waits until they are gone."""
    for process in multiprocessing.active_children():
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
    while multiprocessing.active_children():
        time.sleep(0.01)


def test_jobs_are_run_again_if_workers_die_while_they_are_made() -> None:
    """Whether they die before the first job or after some."""
    pool = Processes(SETTING, 2)

    def jobs(at: int) -> Iterator[Job]:
        for k, job in enumerate(JOBS):
            if k == at:
                kill_workers()
            yield job

    try:
        for at in (0, 4):
            pool.evaluate(JOBS[:4])
            assert tuple(pool.evaluate(jobs(at))) == EXPECTED
    finally:
        pool.close()


DEADLY = 666  # a stage in which these tests make a worker die


@dataclass(frozen=True)
class Deadly:
    """A curriculum that kills the process that asks for the deadly stage."""

    inner: Curriculum
    once: Path | None = None  # written at the first death; with it the stage is harmless
    seconds: float = 0  # that the deadly stage takes instead, if any

    def multipliers(self, stage: int) -> Mapping[str, float]:
        """See `Curriculum`."""
        if stage == DEADLY and not (self.once and self.once.exists()):
            if self.once:
                self.once.touch()
            time.sleep(self.seconds)
            if not self.seconds:
                os.kill(os.getpid(), signal.SIGKILL)
        return self.inner.multipliers(0 if stage == DEADLY else stage)


def deadly(marker: Path | None = None) -> Problem:
    """The setting with such a curriculum."""
    return replace(SETTING, curriculum=Deadly(SETTING.curriculum, marker))  # type: ignore[arg-type]


KILLER = Job(TREES[1], DEADLY, 9_001)


def test_a_job_that_kills_its_workers_is_named() -> None:
    """The pool tries again, and then names tree and seed; it works afterwards."""
    pool = Processes(deadly(), 2)
    try:
        with pytest.raises(EvaluationError, match=r"world seed 9001.*worker died twice[\s\S]*Load"):
            pool.evaluate([*JOBS[:3], KILLER, *JOBS[3:]])
        assert tuple(pool.evaluate(JOBS)) == EXPECTED
    finally:
        pool.close()


def test_a_worker_that_dies_once_costs_nothing_but_time(tmp_path: Path) -> None:
    """The other jobs of the batch, and the job itself, have their outcomes."""
    pool = Processes(deadly(tmp_path / "died"), 2)
    try:
        outcomes = pool.evaluate([*JOBS, KILLER])
    finally:
        pool.close()
    assert tuple(outcomes[:-1]) == EXPECTED
    assert outcomes[-1].seconds > 0


def test_a_stopped_worker_beside_a_dead_one_is_replaced() -> None:
    """It cannot be ended gently; the jobs have their outcomes all the same."""
    pool = Processes(SETTING, 2)
    try:
        pool.evaluate(JOBS)
        one, other = multiprocessing.active_children()
        assert one.pid is not None
        assert other.pid is not None
        os.kill(one.pid, signal.SIGSTOP)
        os.kill(other.pid, signal.SIGKILL)
        assert tuple(pool.evaluate(JOBS)) == EXPECTED
    finally:
        pool.close()


def test_closing_does_not_wait_for_long_episodes() -> None:
    """After Ctrl-C their workers are killed within seconds."""
    pool = Processes(deadly_slow(), 2)
    ctrl_c = Timer(1, os.kill, (os.getpid(), signal.SIGINT))
    ctrl_c.start()
    with pytest.raises(KeyboardInterrupt):
        pool.evaluate([KILLER, replace(KILLER, seed=9_002)])
    began = time.monotonic()
    pool.close()
    assert time.monotonic() - began < 10
    assert multiprocessing.active_children() == []


def test_an_episode_that_never_ends_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the time limit, with tree and seed; the pool is of use afterwards."""
    pool = Processes(deadly_slow(), 2, episode_timeout=300)
    try:
        pool.evaluate(JOBS[:2])  # workers are at hand, however long their start takes
        pool.episode_timeout = 1
        monkeypatch.setattr(processes, "GRACE", 2)
        began = time.monotonic()
        with pytest.raises(
            EvaluationError,
            match=r"world seed 9001.*no answer .* in 1 s.*episode_timeout[\s\S]*Load",
        ):
            pool.evaluate([*JOBS[:3], KILLER, *JOBS[3:]])
        assert time.monotonic() - began < 15
        pool.episode_timeout = 300
        assert tuple(pool.evaluate(JOBS)) == EXPECTED
    finally:
        pool.close()


def deadly_slow() -> Problem:
    """The setting with a curriculum whose deadly stage takes half a minute."""
    return replace(SETTING, curriculum=Deadly(SETTING.curriculum, seconds=30))  # type: ignore[arg-type]


OWN_CLASS = """
import islandgp
from islandgp.domains.gymnasium import Gymnasium

class Mine(Gymnasium):
    def run_episode(self, *arguments, **options):
        return super().run_episode(*arguments, **options)

words = "domain=cartpole gp.generations=1 gp.population=4 gp.validation=0 tracking=off"
run = islandgp.run("domain.factory=__main__:Mine", "evaluator.policy.workers=1", *words.split())
print(len(run.generations))
"""


def test_workers_run_a_class_of_a_script(tmp_path: Path) -> None:
    """As in a notebook. The workers do not execute the script again."""
    (tmp_path / "own.py").write_text(OWN_CLASS)
    process = subprocess.run(
        [sys.executable, "own.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert process.stdout.splitlines()[-1] == "1"


class Broken:
    """A domain of a user's that fails."""

    def run_episode(self, *_: object) -> Outcome:
        """Divides by zero, and not in this line."""
        return self._worked_out()

    def _worked_out(self) -> Outcome:
        raise DomainError("Expected a wheel, found none.")


@pytest.mark.parametrize("points", [float("nan"), float("inf"), -1e200])
def test_points_must_be_finite_and_not_huge(points: float) -> None:
    """Statistics could not be made of them."""
    setting: Any = SimpleNamespace(
        domain=SimpleNamespace(prepare=lambda: None),
        curriculum=SimpleNamespace(multipliers=lambda _: {}),
        observer=None,
        in_world=lambda *_: SimpleNamespace(
            run_episode=lambda *_: Outcome({"p": points}, {}, 1, ("",))
        ),
    )
    with pytest.raises(EvaluationError, match=r"world seed 1, stage 1, found .* points; lower"):
        simulate(setting, Job("PatrolWaypoint", 0, 1, leaf("PatrolWaypoint")))


def test_an_error_names_the_line_of_the_user_s_code() -> None:
    """Where it was raised, among all that the program itself called."""
    setting: Any = SimpleNamespace(
        domain=SimpleNamespace(prepare=lambda: None),
        curriculum=SimpleNamespace(multipliers=lambda _: {}),
        in_world=lambda *_: Broken(),
        observer=None,
    )
    line = Broken._worked_out.__code__.co_firstlineno + 1
    with pytest.raises(EvaluationError, match=f"found none, in {__file__}, line {line}. The run"):
        simulate(setting, Job("PatrolWaypoint", 0, 1, leaf("PatrolWaypoint")))
