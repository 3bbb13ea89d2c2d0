"""A sweep's folder: the runs of one name, of all commands and launchers.

sweep.json      the jobs: one entry each; later commands add to it
<job>/          each job's run (records.folder)
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from math import inf
from pathlib import Path
from statistics import fmean, median, stdev
from textwrap import indent
from time import time
from typing import Any, Final
from uuid import uuid4

from filelock import FileLock

from islandgp.atomic_files import reading, usable, write_atomic
from islandgp.errors import RunError
from islandgp.gate import check_file, cleaned_values, is_inside, read_bytes
from islandgp.plain import from_json, read_json
from islandgp.records.files import pretty
from islandgp.records.folder import RunFolder, Status, locked, take
from islandgp.records.parameters import TASK, key_of, short_key
from islandgp.records.values import fallback_words, run_values
from islandgp.statistics import detectable_shift, least_p
from islandgp.text import in_points, title

MAX_TAG: Final = 5000  # characters of a tag's value in MLflow


@dataclass(frozen=True, slots=True)
class SweepJob:
    """One job of a sweep."""

    slot: str  # the folder named by its configuration
    folder: str  # the run's folder inside the sweep's: the slot, or a new one beside it
    supervisor: str
    seed: int
    choices: tuple[str, ...]  # its overrides except the seed, as key=value
    command: str  # that runs this job alone


@dataclass(frozen=True, slots=True)
class Sweep:
    """A sweep's folder, and the content of its sweep.json."""

    path: Path  # of the folder; not in the file
    id: str
    started: int  # ms since 1970
    commands: tuple[str, ...]  # oldest first
    jobs: tuple[SweepJob, ...]

    def arm(self, job: SweepJob) -> str:
        """Name of a job's arm: what differs between the jobs, apart from their seeds.

        A supervisor has its name; other settings are `key=value`, with the last two parts of a
        dotted key, or more if two keys end alike. Without a difference: the supervisor's name.
        """
        levels = {key: value for key, value in self.levels(job).items() if key != "supervisor"}
        keys = self.studied_keys()
        settings = [f"{short_key(key, keys)}={value}" for key, value in levels.items()]
        if settings and len({job.supervisor for job in self.jobs}) == 1:
            return " ".join(settings)
        return " ".join([job.supervisor, *settings])

    def levels(self, job: SweepJob) -> dict[str, str]:
        """A job's values of the keys that the sweep studies, in the order of the keys."""
        different = {*job.choices} - self._common()
        return {
            key_of(choice).replace("/", "."): choice.partition("=")[2]
            for choice in sorted(different, key=key_of)
        }

    def tags(self, job: SweepJob) -> dict[str, str]:
        """A job's values of the keys that the sweep studies, as tags by short name."""
        keys = self.studied_keys()
        return {f"factor.{short_key(k, keys)}": v[:MAX_TAG] for k, v in self.levels(job).items()}

    def studied_keys(self) -> frozenset[str]:
        """Keys, and groups with dots, of the overrides that are not common to all jobs."""
        choices = {choice for job in self.jobs for choice in job.choices} - self._common()
        return frozenset(key_of(choice).replace("/", ".") for choice in choices)

    def _common(self) -> set[str]:
        """The overrides of all jobs."""
        return set.intersection(*({*job.choices} for job in self.jobs)) if self.jobs else set()

    def arms(self) -> dict[str, list[SweepJob]]:
        """The jobs by arm."""
        by_arm: dict[str, list[SweepJob]] = {}
        for job in self.jobs:
            by_arm.setdefault(self.arm(job), []).append(job)
        return by_arm

    def run(self, job: SweepJob) -> RunFolder:
        """The folder of a job."""
        return RunFolder(self.path / job.folder)

    def at_work(self) -> bool:
        """True if a process is working on the sweep."""
        return locked(self.path / ".lock")

    def status(self) -> Status:
        """The common status of all jobs.

        Stopped jobs take precedence over failed ones, as the sweep can be continued.
        """
        statuses = {self.run(job).status() for job in self.jobs}
        for status in (Status.RUNNING, Status.KILLED, Status.FAILED):
            if status in statuses:
                return status
        return Status.FINISHED


def read_sweep(path: Path) -> Sweep | None:
    """The sweep in a folder; None if there is none. Raises RunError if its file is damaged."""
    file = path / "sweep.json"
    for each in (file, path / ".lock"):
        check_file(each)
    if not file.exists():
        return None
    with reading("the jobs of a sweep", file, "delete it: the runs beside it stay as they are"):
        values = {**cleaned_values(read_json(read_bytes(file))), "path": str(path)}
        sweep = from_json(Sweep, values)
        for job in sweep.jobs:
            if not is_inside(job.folder) or (path / job.folder).is_symlink():
                raise ValueError(f"the job {job.folder!r} is not in the sweep's folder")
    return sweep


def write_sweep(sweep: Sweep) -> None:
    """Writes sweep.json."""
    values = {name: value for name, value in asdict(sweep).items() if name != "path"}
    write_atomic(sweep.path / "sweep.json", pretty(values))


@contextmanager
def at_work(path: Path, command: str, jobs: Sequence[SweepJob]) -> Iterator[Sweep]:
    """A context in which this process alone works on a sweep, to which it adds jobs.

    Raises:
        RunError: another sweep is at work in the folder, or the folder cannot be used.
    """
    lock = FileLock(path / ".lock")
    busy = RunError(
        f"Expected to be the only sweep in {path}, found another one at work there; wait for it, or"
        " give this one another name=..."
    )
    try:
        with usable(path):
            take(lock, path, busy)
            old = read_sweep(path) or Sweep(path, uuid4().hex, int(1000 * time()), (), ())
            # A new job replaces the old one of the same slot.
            merged = tuple({job.slot: job for job in (*old.jobs, *jobs)}.values())
            commands = (*(c for c in old.commands if c != command), command)
            sweep = replace(old, commands=commands, jobs=merged)
            write_sweep(sweep)
        yield sweep
    finally:
        lock.release()


def arm_of(folder: Path) -> str:
    """The arm of a run in its sweep; "" if the run is not a job of a sweep."""
    found = job_of(folder)
    return found[0].arm(found[1]) if found else ""


def job_of(folder: Path) -> tuple[Sweep, SweepJob] | None:
    """A run's sweep and its job; None if it is not a job of a sweep."""
    sweep = read_sweep(folder.parent)
    jobs = () if sweep is None else sweep.jobs
    return next(((sweep, job) for job in jobs if sweep and job.folder == folder.name), None)


SAME: Final = ("lineage.csv", "best.bt")  # files that are equal in identical runs
LAST: Final = ("diversity", "fallback's answers")  # columns of the table, after those of tiers
LEAST_PAIRS: Final = 6  # with fewer, no signed-rank test has p < 0.05


def power_line(sweep: Sweep) -> str:
    """What a paired test of two arms can show with the seeds of a sweep; "" for a single arm."""
    seeds = [len({job.seed for job in jobs}) for jobs in sweep.arms().values()]
    if len(seeds) < 2:
        return ""
    if (n := min(seeds)) < LEAST_PAIRS:
        return (
            f"Seeds: {n} an arm, with which no paired test can show a difference (least p"
            f" {least_p(n):.2g}); {LEAST_PAIRS} can."
        )
    return (
        f"Seeds: {n} an arm; a paired test finds a difference of about {detectable_shift(n):.2g}"
        " standard deviations of the pairs' differences with 80 % power."
    )


def arm_table(sweep: Sweep) -> str:
    """A head and one line per arm.

    Columns: the validation mean with its standard deviation, the median generation of the first
    robot of each milestone over all runs, the mean diversity, and the share of the fallback's
    answers. Validation means under different tasks are marked.

    Raises:
        RunError: a finished run is damaged.
    """
    own_scale = any(key.partition(".")[0] in TASK for key in sweep.studied_keys())
    rows = []
    for name, jobs in sweep.arms().items():
        runs = [run.summary() for job in jobs if (run := sweep.run(job)).finished()]
        values = [run_values(summary) for summary in runs]
        rows.append(
            {
                "arm": _one_line(name),
                "finished": f"{len(runs)} of {len(jobs)}",
                "validation mean" + ", own scale" * own_scale: _spread(values),
                **_emergence(values),
                "diversity": f"{fmean(v['mean_diversity'] for v in values):.3f}" if runs else "",
                "fallback's answers": fallback_words(runs),
            }
        )
    heads = sorted(dict.fromkeys(head for row in rows for head in row), key=LAST.__contains__)
    columns = [(head, *(row.get(head, "") for row in rows)) for head in heads]
    full = [cells for cells in columns if any(cells[1:]) or cells[0] != LAST[1]]
    padded = [[f"{cell:<{max(map(len, cells))}}" for cell in cells] for cells in full]
    return "\n".join("  ".join(line).rstrip() for line in zip(*padded, strict=True))


def _one_line(arm: str) -> str:
    """An arm's name, in which a quoted text may have line breaks."""
    return " ".join(arm.split())


def _spread(values: Sequence[Mapping[str, Any]]) -> str:
    means = [v["validation_mean"] for v in values if v["validation_mean"] is not None]
    deviation = f" ± {in_points(stdev(means))}" if len(means) > 1 else ""
    return f"{in_points(fmean(means))}{deviation}" if means else ""


def _emergence(values: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """The median over all runs, and the number of runs with one, by tier; others are censored."""
    cells = {}
    for key in dict.fromkeys(key for v in values for key in v if key.startswith("first.")):
        firsts = [inf if v[key] is None else v[key] for v in values if key in v]
        reached, middle = sum(first < inf for first in firsts), median(firsts)
        text = f"{middle:g}" if middle < inf else "not reached" if reached else "never"
        cells[title(key.removeprefix("first."))] = f"{text} ({reached} of {len(firsts)})"
    return cells


def identical_arms(sweep: Sweep) -> list[tuple[str, ...]]:
    """The names of arms whose finished runs have the same individuals and best trees, by group."""
    groups: dict[Any, list[str]] = {}
    for arm, jobs in sweep.arms().items():
        finished = {job.seed: run for job in jobs if (run := sweep.run(job)).finished()}
        runs = sorted(
            (seed, *(sha256((run.path / name).read_bytes()).digest() for name in SAME))
            for seed, run in finished.items()
        )
        groups.setdefault(tuple(runs), []).append(_one_line(arm))
    return [tuple(names) for runs, names in groups.items() if runs and len(names) > 1]


def sweep_note(sweep: Sweep, table: str) -> str:
    """The sweep's description in MLflow, in Markdown: the table of its arms and its commands."""
    blocks = [indent(table, "    "), *(f"    {command}" for command in sweep.commands)]
    return "\n\n".join([*blocks, f"Records: `{sweep.path}`", ""])
