"""A sweep's folder: the runs of one name, of all commands and launchers.

sweep.json      what was asked for: one entry a job; later commands add to it
<job>/          each job's run (records.folder)
tracking.json   the MLflow run that is the parent of all of them
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import time
from uuid import uuid4

from filelock import FileLock

from islandgp.atomic_files import usable, write_atomic
from islandgp.errors import RunError, brief
from islandgp.plain import DECODE_ERRORS, validate_json
from islandgp.records.files import pretty
from islandgp.records.folder import RunFolder, Status
from islandgp.records.locks import locked, take
from islandgp.trust import must_be_no_link


@dataclass(frozen=True, slots=True)
class SweepJob:
    """One job of a sweep."""

    slot: str  # the folder that its configuration names
    folder: str  # the run's folder inside the sweep's: the slot, or a new one beside it
    supervisor: str
    seed: int
    choices: tuple[str, ...]  # its overrides but the seed, as key=value
    generations: int
    command: str  # that runs this job alone
    search: str = ""  # the search whose trial it was last; "" for a job of a plain sweep
    pruned: int | None = None  # the generation in which a search stopped it


@dataclass(frozen=True, slots=True)
class SweepFile:
    """Content of sweep.json."""

    id: str
    started: int  # ms since 1970
    commands: tuple[str, ...]  # oldest first
    jobs: tuple[SweepJob, ...]

    def arm(self, job: SweepJob) -> str:
        """Name of a job's arm: its supervisor, and the overrides that are not common to all."""
        everywhere = set.intersection(*(set(j.choices) for j in self.jobs))
        distinguishing = {*job.choices} - everywhere - {f"supervisor={job.supervisor}"}
        return " ".join([job.supervisor, *sorted(distinguishing)])

    def arms(self) -> dict[str, list[SweepJob]]:
        """The jobs by arm."""
        by_arm: dict[str, list[SweepJob]] = {}
        for job in self.jobs:
            by_arm.setdefault(self.arm(job), []).append(job)
        return by_arm


class SweepFolder:
    """Writes and reads one sweep's folder; one sweep at a time works in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = FileLock(path / ".lock")

    def open(self, command: str, jobs: Sequence[SweepJob]) -> None:
        """Takes the folder for this process, and adds the jobs to what was asked for.

        Raises:
            RunError: another sweep is at work here, or the folder cannot be used.
        """
        with usable(self.path):
            busy = RunError(
                f"Expected to be the only sweep in {self.path}, found another one at work there;"
                " wait for it, or give this one another name=..."
            )
            take(self._lock, self.path, busy)
            old = self.read() or SweepFile(uuid4().hex, int(1000 * time()), (), ())
            commands = (*(c for c in old.commands if c != command), command)
            self._write(SweepFile(old.id, old.started, commands, _merged(old.jobs, jobs)))

    def _write(self, file: SweepFile) -> None:
        write_atomic(self.path / "sweep.json", pretty(asdict(file)))

    def enter(self, job: SweepJob) -> None:
        """Adds a trial of a search, or replaces its entry; any process may."""
        with usable(self.path), FileLock(self.path / ".entering"):
            file = self.read()
            assert file is not None, "the search has opened the folder"
            self._write(replace(file, jobs=_merged(file.jobs, [job])))

    def close(self) -> None:
        """Gives the folder back."""
        self._lock.release()

    def read(self) -> SweepFile | None:
        """The content of sweep.json; None if there is none. Raises RunError if it is damaged."""
        path = self.path / "sweep.json"
        for file in (path, self.path / ".lock", self.path / "tracking.json"):
            must_be_no_link(file)
        if not path.exists():
            return None
        try:
            plain = validate_json(SweepFile, path.read_bytes())
            jobs = (SweepJob(**{**j, "choices": tuple(j["choices"])}) for j in plain["jobs"])
            return SweepFile(**{**plain, "commands": tuple(plain["commands"]), "jobs": tuple(jobs)})
        except DECODE_ERRORS as error:
            raise RunError(
                f"Expected the jobs of a sweep in {path}, found a damaged file ({brief(error)});"
                " delete it: the runs beside it stay as they are."
            ) from error

    def run(self, job: SweepJob) -> RunFolder:
        """A job's own folder."""
        return RunFolder(self.path / job.folder)

    def at_work(self) -> bool:
        """True if a process is working on the sweep."""
        return locked(self.path / ".lock")

    def status(self, file: SweepFile) -> Status:
        """The common status of all jobs.

        Stopped jobs count for more than failed ones: the sweep is not at its end.
        """
        statuses = {self.run(job).status() for job in file.jobs if job.pruned is None}
        for status in (Status.RUNNING, Status.KILLED, Status.FAILED):
            if status in statuses:
                return status
        return Status.FINISHED


def _merged(old: Sequence[SweepJob], new: Sequence[SweepJob]) -> tuple[SweepJob, ...]:
    """All jobs, a new one in the place of the old one of its slot."""
    return tuple({job.slot: job for job in (*old, *new)}.values())


def arm_of(folder: Path) -> str:
    """The arm of a run in its sweep, as far as the sweep's jobs are known; "" for no job."""
    file, job = job_of(folder)
    return "" if file is None or job is None else file.arm(job)


def job_of(folder: Path) -> tuple[SweepFile | None, SweepJob | None]:
    """A run's sweep, and its job there; None for what there is not."""
    file = SweepFolder(folder.parent).read()
    jobs = () if file is None else file.jobs
    return file, next((job for job in jobs if job.folder == folder.name), None)
