"""Progress of a sweep in one line, read from its folders, with any launcher."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from time import time
from typing import Final, Literal, Self

from islandgp.records.folder import RunFolder, Status
from islandgp.records.values import validation_mean
from islandgp.running.progress import duration
from islandgp.sweep.folder import SweepJob
from islandgp.text import in_points, title

PERIOD: Final = 1.0  # s between two updates


@dataclass(frozen=True, slots=True)
class SweepStart:
    """State of a sweep at its start. It is sent to the jobs, so it has plain values only."""

    at: float  # s since 1970, by this process's clock
    jobs: dict[Path, SweepJob]  # by the folder named by their configuration
    before: int  # generations that existed before

    @classmethod
    def now(cls, jobs: dict[Path, SweepJob]) -> Self:
        """The state of a sweep that starts now. Removes earlier errors of its jobs."""
        start = cls(time(), jobs, 0)
        for run in start.runs():
            (run.path / "error.txt").unlink(missing_ok=True)
        return replace(start, before=sum(run.completed_generations() for run in start.runs()))

    def run(self, named: Path) -> RunFolder:
        """The folder in which the job whose configuration names `named` runs."""
        return RunFolder(named.with_name(self.jobs[named].folder))

    def runs(self) -> Iterator[RunFolder]:
        """All jobs' folders."""
        return (self.run(named) for named in self.jobs)

    def failed(self, run: RunFolder) -> bool:
        """True if a job has failed since the start."""
        return (run.path / "error.txt").exists()


def sweep_line(start: SweepStart, beginning: RunFolder | None = None) -> str:
    """A line with the numbers of finished, running and failed jobs, and the time left.

    The job of the folder `beginning` counts as running, unless it is finished.
    """
    states: Counter[Status] = Counter()
    failed = generations = 0
    for run in start.runs():
        status = run.status()
        if beginning is not None and run.path == beginning.path and status is not Status.FINISHED:
            status = Status.RUNNING
        states[status] += 1
        failed += status is Status.FAILED and start.failed(run)
        generations += run.completed_generations()
    names = ", ".join(dict.fromkeys(path.parent.name for path in start.jobs))
    counts = (
        f"{states[Status.FINISHED]} of {len(start.jobs)} done,"
        f" {states[Status.RUNNING]} running, {failed} failed"
    )
    total = sum(job.generations for job in start.jobs.values())
    new = generations - start.before
    line = f"sweep {names}: {counts}, generation {generations} of {total}"
    if not new:
        return line
    return f"{line}, {duration((time() - start.at) * (total - generations) / new)} left"


def job_line(run: RunFolder) -> str:
    """The result of one job in a line."""
    if not run.finished():
        if run.status() is Status.RUNNING:
            return f"{run.path.name}: another process is at work on it"
        reason = run.reason()
        return f"{run.path.name}: {f'failed: {reason}' if reason else 'stopped'}"
    s = run.summary()
    tier, first = next(iter(s["first"].items()))  # the easiest milestone
    milestone = f"{title(tier)} {run.agent}"
    emerged = f"no {milestone}" if first is None else f"first {milestone} in generation {first}"
    mean = validation_mean(s)
    robot = "not validated" if mean is None else f"validation mean {in_points(mean)}"
    return f"{run.path.name}: {robot}, {emerged}, {duration(s['seconds'])}"


class Watch:
    """Shows the line while a launcher is at work. A context manager."""

    def __init__(self, start: SweepStart, mode: Literal["plain", "off"]) -> None:
        """`plain`: a line whenever a job has ended."""
        self.start = start
        self.mode = mode
        self._over = Event()
        self._thread = Thread(target=self._work, name="sweep progress", daemon=True)

    def __enter__(self) -> Self:
        if self.mode != "off":
            self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        for n, runs in enumerate(self._ended()):
            for run in runs:
                print(job_line(run), file=sys.stderr, flush=True)
            if runs or not n:
                print(sweep_line(self.start), file=sys.stderr, flush=True)

    def _ended(self) -> Iterator[list[RunFolder]]:
        """At each update, the jobs that have ended since the last one."""
        reported = {run.path for run in self.start.runs() if run.finished()}
        yield []
        over = False
        while not over:
            over = self._over.wait(PERIOD)
            runs = (run for run in self.start.runs() if run.finished() or self.start.failed(run))
            ended = [run for run in runs if run.path not in reported]
            reported.update(run.path for run in ended)
            yield ended
