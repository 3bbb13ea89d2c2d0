"""Episodes in a persistent pool of processes on this machine.

Results do not depend on the number of workers, as an episode is a function of its job. If a worker
dies, it is replaced, and the unfinished jobs are run again one at a time; a job whose worker dies
twice is reported and ends the run. Closing takes a few seconds at most, as workers that do not end
by themselves are killed.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from math import inf
from multiprocessing.connection import wait
from threading import Thread
from time import sleep
from typing import Final

from pydantic import BaseModel, Field

from islandgp.domain import Outcome
from islandgp.errors import EvaluationError
from islandgp.evaluation.base import Job, Problem, blame, simulate
from islandgp.evaluation.forkserver import set_imports

PERIOD: Final = 0.5  # s between two checks of the parent, or of the pool's thread
PR_SET_PDEATHSIG: Final = 1  # of Linux's prctl


def end_with_parent(parent: int) -> None:
    """Ends this process when its parent has died; `parent` is the parent's process id.

    On Linux the kernel does this. A thread checks as well, for other systems and for a parent that
    died before the kernel was asked.
    """
    if os.name != "posix":
        return  # Windows does not report the death of a parent
    killed_with_parent()
    Thread(target=_watch, args=(parent,), name="parent", daemon=True).start()


def killed_with_parent() -> None:
    """Asks Linux to kill this process when the thread that started it ends."""
    if sys.platform == "linux":
        import ctypes  # imported only where it is needed

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        sleep(PERIOD)
    os._exit(1)


ENDING: Final = 1.0  # s for workers to end by themselves

GRACE: Final = 2.0  # s for a worker to report an episode that exceeds the limit

NO_THREAD: Final = "can't start new thread"  # Python's message

POOL_ENDED: Final = (
    "Expected enough memory and threads to pass episodes to the workers, found that the thread"
    " which does so ended; raise the limit that is too low (ulimit -a shows them), or set fewer"
    " evaluator.policy.workers, and repeat the command."
)

_problem: Problem | None = None  # in a worker
_limit = 0.0  # time limit of an episode in a worker, s; 0: none


def cores() -> int:
    """Cores that this process may use, >= 1."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start(problem: Problem, limit: float) -> None:
    global _problem, _limit
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    killed_with_parent()  # the server of forks, which ends with the run
    Thread(target=_end_with_parent, daemon=True).start()
    _problem, _limit = problem, limit
    gc.freeze()  # the collector need not walk over imported modules again and again
    gc.set_threshold(10_000)  # an episode makes thousands of objects, few of them in cycles


def _end_with_parent() -> None:
    """Ends this worker when its parent has died."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _run(job: Job) -> Outcome:
    assert _problem is not None
    return simulate(_problem, job, _limit)


class ProcessesSettings(BaseModel, frozen=True, extra="forbid"):
    """Number of processes and time limits."""

    workers: int = Field(ge=0, le=1024)  # 0: one for each core
    episode_timeout: float = Field(600, ge=0, le=1e6)  # s until an episode is given up; 0: never


class Processes:
    """The evaluator for one machine."""

    Settings = ProcessesSettings

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
        self.simulated = 0
        self._early_results: dict[Job, Future[Outcome]] = {}  # started before `evaluate` is called
        self._submitted_futures: list[Future[Outcome]] = []  # of the jobs that may not have ended
        self._pool = self._new_pool()

    def _new_pool(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("forkserver" if os.name == "posix" else "spawn")
        set_imports(type(self.problem.domain).__module__)
        return ProcessPoolExecutor(
            self.workers, context, _start, (self.problem, self.episode_timeout)
        )

    def start(self, job: Job) -> None:
        """See `EarlyEvaluator`."""
        if job not in self._early_results:
            with suppress(BrokenProcessPool):  # `evaluate` submits the job again
                self._early_results[job] = self._submitted(job)

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.simulated += len(jobs)
        early_results, self._early_results = self._early_results, {}
        try:
            futures = [early_results.get(job) or self._submitted(job) for job in jobs]
        except BrokenProcessPool:  # a worker died between two calls
            return self._one_by_one(jobs, {})
        done: dict[Job, Outcome] = {}
        self._submitted_futures = futures
        wait_for(futures, PERIOD, FIRST_EXCEPTION)  # one wait for all costs less than one for each
        try:
            return [self._result(job, f, done) for job, f in zip(jobs, futures, strict=True)]
        except BrokenProcessPool:
            return self._one_by_one(jobs, done)

    def _submitted(self, job: Job) -> Future[Outcome]:
        """Submits a job. Raises BrokenProcessPool, also if workers cannot be started."""
        try:
            self._submitted_futures.append(future := self._pool.submit(_run, job))
        except (EOFError, OSError) as error:  # the forkserver was killed or cannot be reached
            _kill_fork_server()
            raise BrokenProcessPool(str(error)) from error
        return future

    def _result(self, job: Job, future: Future[Outcome], done: dict[Job, Outcome]) -> Outcome:
        """Waits for a job. All jobs before it have ended, so it runs at the latest from now on.

        A worker enforces the time limit itself, unless it hangs; then it is replaced.

        Raises:
            BrokenProcessPool: a worker died.
            EvaluationError: the job failed or took too long, or the pool's thread ended.
        """
        if not self._ends(future):
            self._renew()
            raise EvaluationError(
                blame(
                    job,
                    f"no answer of its worker in {self.episode_timeout:g} s; find out why,"
                    " or raise evaluator.policy.episode_timeout",
                )
            )
        try:
            done[job] = future.result()
        except BrokenProcessPool as error:
            if NO_THREAD in str(error.__cause__):  # reported so from Python 3.12 on
                raise EvaluationError(POOL_ENDED) from None
            raise
        return done[job]

    def _ends(self, future: Future[Outcome]) -> bool:
        """Wait for a future; False if it takes longer than a worker may take to report a timeout.

        A suspension of this process counts as one PERIOD at most.

        Raises:
            EvaluationError: the pool's thread, which ends futures, has ended itself. Up to Python
                3.11 this happens if it cannot start the thread that sends jobs to the workers.
        """
        limit = self.episode_timeout + GRACE if self.episode_timeout else inf  # s
        waited = 0.0  # s
        while not (future.done() or wait_for([future], PERIOD).done):
            if not _manages(self._pool) and not future.done():
                raise EvaluationError(POOL_ENDED)
            waited += PERIOD
            if waited >= limit:
                return False
        return True

    def _one_by_one(self, jobs: Sequence[Job], done: dict[Job, Outcome]) -> list[Outcome]:
        """Finishes the jobs after a worker died; finds the one that kills its worker."""
        self._renew()
        for job in (job for job in jobs if job not in done):
            for last in (False, True):
                try:
                    self._result(job, self._submitted(job), done)
                    break
                except BrokenProcessPool:
                    self._renew()
                    if last:
                        raise EvaluationError(blame(job, "that its worker died twice")) from None
        return [done[job] for job in jobs]

    def _renew(self) -> None:
        self.close()
        self._pool = self._new_pool()

    def close(self) -> None:
        """See `Evaluator`."""
        _release(self._submitted_futures)
        _end(self._pool)


def _manages(pool: ProcessPoolExecutor) -> bool:
    """True while the pool's own thread runs, which passes jobs to workers and ends futures."""
    thread: Thread | None = getattr(pool, "_executor_manager_thread", None)
    return thread is not None and thread.is_alive()


def _end(pool: ProcessPoolExecutor) -> None:
    """Shuts the pool down; kills workers that are busy, suspended or stuck."""
    # Python has a public `kill_workers` from 3.14 on.
    workers = list((pool._processes or {}).values())
    if not _manages(pool):
        # Its thread was not started, or has ended: nobody stops the workers, and the interpreter
        # would wait for them at its exit.
        for worker in workers:
            worker.kill()
        pool.shutdown(wait=False, cancel_futures=True)
        return
    closing = Thread(target=pool.shutdown, kwargs={"cancel_futures": True}, daemon=True)
    closing.start()
    try:
        closing.join(ENDING)
    finally:  # also when Ctrl-C is pressed again
        for worker in workers if closing.is_alive() else ():
            worker.kill()
    closing.join(ENDING)
    if closing.is_alive():
        _kill_fork_server()
        closing.join(ENDING)


def _release(futures: Iterable[Future[Outcome]]) -> None:
    """Releases the locks of futures that this thread still has.

    Ctrl-C in the moment between taking such a lock and entering its context leaves it locked. The
    pool's thread, which ends the futures, would then wait for ever, and so would the interpreter.
    """
    for future in futures:
        with suppress(RuntimeError):  # this thread does not have it
            while True:
                future._condition.release()


def _kill_fork_server() -> None:
    """Kills the forkserver and waits for its death; a new one is started when it is needed.

    A suspended one never reports worker exits, and shutdown() would hang. A dying one
    accepts no connections, but multiprocessing considers it alive and does not start another.
    """
    if os.name != "posix":
        return
    from multiprocessing import forkserver  # which other systems lack

    server = getattr(forkserver, "_forkserver", None)
    pid: int | None = getattr(server, "_forkserver_pid", None)
    if pid is not None:
        with suppress(ProcessLookupError, ChildProcessError):
            os.kill(pid, signal.SIGKILL)
            if hasattr(os, "waitid"):  # macOS has it from Python 3.13 on
                os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # multiprocessing reaps it
