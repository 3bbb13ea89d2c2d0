"""Episodes in a pool of processes on this machine, by loky.

Results do not depend on the number of workers, as an episode is a function of its job. If a worker
dies, loky ends its pool; a new one runs the unfinished jobs again one at a time. A job whose worker
dies twice is reported and ends the run.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from errno import ENOSPC
from math import inf
from multiprocessing import resource_tracker, set_start_method
from threading import Thread
from time import sleep
from typing import Final

from loky import ProcessPoolExecutor
from pydantic import BaseModel, Field

from islandgp.domain import Outcome
from islandgp.errors import EvaluationError, brief
from islandgp.evaluation.base import Job, Problem, blame, simulate

PERIOD: Final = 0.5  # s between two looks at the parent, or at an episode
GRACE: Final = 10.0  # s for a worker to start, and to report an episode that exceeds the limit
ENDING: Final = 5.0  # s for the pool to end after its workers were killed
PR_SET_PDEATHSIG: Final = 1  # of Linux's prctl
STOPPING: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)

_problem: Problem | None = None  # in a worker
_limit = 0.0  # time limit of an episode in a worker, s; 0: none


def cores() -> int:
    """Cores that this process may use, >= 1."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def end_with_parent(parent: int) -> None:
    """Ends this process when its parent has died; `parent` is the parent's process id.

    On Linux the kernel does this. A thread checks as well, for other systems and for a parent that
    died before the kernel was asked.
    """
    if os.name != "posix":
        return  # Windows does not report the death of a parent
    if sys.platform == "linux":
        import ctypes  # imported only where it is needed

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    Thread(target=_watch, args=(parent,), name="parent", daemon=True).start()


def prepare_worker(parent: int) -> None:
    """Prepares a process of loky: it ends with its parent, and code may use multiprocessing."""
    end_with_parent(parent)
    set_start_method(None, force=True)  # loky's, which others do not know


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        sleep(PERIOD)
    os._exit(1)


def _start(problem: Problem, limit: float, parent: int) -> None:
    """Prepares a worker, which leaves Ctrl-C to its parent."""
    global _problem, _limit
    prepare_worker(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
    _problem, _limit = problem, limit


def _run(job: Job) -> Outcome:
    assert _problem is not None
    return simulate(_problem, job, _limit)


@contextmanager
def _signals_held() -> Iterator[None]:
    """A context in which signals that stop a command wait; processes started in it inherit that.

    So no pool stays half made, and Ctrl-C does not interrupt the imports of a worker.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # its start would let the signals through
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


class ProcessesSettings(BaseModel, frozen=True, extra="forbid"):
    """Number of processes and time limits."""

    workers: int = Field(ge=0, le=1024)  # 0: one for each core
    episode_timeout: float = Field(600, ge=0, le=1e6)  # s until an episode is given up; 0: never


class Processes:
    """The evaluator for one machine."""

    Settings = ProcessesSettings
    early = True

    @classmethod
    def make(cls, settings: ProcessesSettings, problem: Problem) -> Processes:
        """See `Evaluator`."""
        return cls(problem, settings.workers or cores(), episode_timeout=settings.episode_timeout)

    def __init__(self, problem: Problem, workers: int, *, episode_timeout: float = 0) -> None:
        """Starts `workers` >= 1 processes, at the first job.

        An episode that takes more than `episode_timeout` seconds ends the run; 0: none does.
        """
        self.problem = problem
        self.workers = workers
        self.episode_timeout = episode_timeout
        self._pool: ProcessPoolExecutor | None = None

    def evaluate(self, jobs: Iterable[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        following, taken, futures = iter(jobs), list[Job](), list[Future[Outcome]]()
        done: dict[Job, Outcome] = {}
        try:
            for job in following:
                taken.append(job)
                futures.append(self._submitted(job))
            for job, future in zip(taken, futures, strict=True):
                done[job] = self._result(job, future)
        except BrokenProcessPool:  # a worker died, now or between two calls
            self.close()
            taken += following
            for job in taken:
                if job not in done:
                    done[job] = self._again(job)
        return [done[job] for job in taken]

    def _again(self, job: Job) -> Outcome:
        """Runs a job while no other one runs; raises EvaluationError if its worker dies again."""
        try:
            return self._result(job, self._submitted(job))
        except BrokenProcessPool as error:
            self.close()
            fault = f"that its worker died twice ({brief(error)})"
            raise EvaluationError(blame(job, fault)) from None

    def _submitted(self, job: Job) -> Future[Outcome]:
        """Submits a job; starts the pool if there is none.

        Raises:
            BrokenProcessPool: a worker died.
            EvaluationError: the workers cannot be started.
        """
        if self._pool is None:
            try:
                with _signals_held():
                    arguments = (self.problem, self.episode_timeout, os.getpid())
                    self._pool = ProcessPoolExecutor(
                        self.workers, initializer=_start, initargs=arguments
                    )
                    self._pool.submit(os.getpid)  # which starts the workers
            except OSError as error:
                place = " in /dev/shm" if error.errno == ENOSPC else ""  # of semaphores on Linux
                raise EvaluationError(
                    f"Expected to start {self.workers} worker processes, found:"
                    f" {error.strerror or error}{place}; correct that, or use evaluator=serial."
                ) from error
        future: Future[Outcome] = self._pool.submit(_run, job)
        return future

    def _result(self, job: Job, future: Future[Outcome]) -> Outcome:
        """Waits for a job. All jobs before it have ended, so it runs at the latest from now on.

        A worker enforces the time limit itself, unless it hangs; then the pool is ended. A
        suspension of this process counts as one PERIOD at most.

        Raises:
            BrokenProcessPool: a worker died.
            EvaluationError: the job failed or took too long.
        """
        left = self.episode_timeout + GRACE if self.episode_timeout else inf  # s
        while not (future.done() or wait([future], PERIOD).done):
            left -= PERIOD
            if left <= 0:
                self.close()
                fault = (
                    f"no answer of its worker in {self.episode_timeout:g} s; find out why, or raise"
                    " evaluator.policy.episode_timeout"
                )
                raise EvaluationError(blame(job, fault))
        return future.result()

    def close(self) -> None:
        """See `Evaluator`. Kills the workers, which may be busy, suspended or stuck."""
        pool, self._pool = self._pool, None
        if pool is not None:
            closing = Thread(target=pool.shutdown, kwargs={"kill_workers": True}, daemon=True)
            closing.start()
            closing.join(ENDING)
