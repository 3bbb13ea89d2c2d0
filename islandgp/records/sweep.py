"""A sweep's folder: the runs of one name, of all commands and launchers.

sweep.json      the jobs: one entry each; later commands add to it
<job>/          each job's run (records.folder)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import time
from typing import Final
from uuid import uuid4

from filelock import FileLock

from islandgp.atomic_files import usable, write_atomic
from islandgp.errors import RunError, brief
from islandgp.gate import check_file, cleaned_values, is_inside, read_bytes
from islandgp.plain import DECODE_ERRORS, from_json, read_json
from islandgp.records.files import pretty
from islandgp.records.folder import RunFolder, Status, locked, take
from islandgp.records.parameters import key_of, short_key

MAX_TAG: Final = 5000  # characters of a tag's value in MLflow


@dataclass(frozen=True, slots=True)
class SweepJob:
    """One job of a sweep."""

    slot: str  # the folder named by its configuration
    folder: str  # the run's folder inside the sweep's: the slot, or a new one beside it
    supervisor: str
    seed: int
    choices: tuple[str, ...]  # its overrides except the seed, as key=value
    generations: int
    command: str  # that runs this job alone


@dataclass(frozen=True, slots=True)
class SweepFile:
    """Content of sweep.json."""

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


class SweepFolder:
    """Writes and reads the folder of a sweep; one command at a time uses it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = FileLock(path / ".lock")

    def open(self, command: str, jobs: Sequence[SweepJob]) -> None:
        """Locks the folder for this process, and adds the jobs to sweep.json.

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
            # A new job replaces the old one of the same slot.
            merged = tuple({job.slot: job for job in (*old.jobs, *jobs)}.values())
            file = SweepFile(old.id, old.started, commands, merged)
            write_atomic(self.path / "sweep.json", pretty(asdict(file)))

    def close(self) -> None:
        """Unlocks the folder."""
        self._lock.release()

    def read(self) -> SweepFile | None:
        """The content of sweep.json; None if there is none. Raises RunError if it is damaged."""
        path = self.path / "sweep.json"
        for file in (path, self.path / ".lock"):
            check_file(file)
        if not path.exists():
            return None
        try:
            sweep = from_json(SweepFile, cleaned_values(read_json(read_bytes(path))))
            for job in sweep.jobs:
                if not is_inside(job.folder) or (self.path / job.folder).is_symlink():
                    raise ValueError(f"the job {job.folder!r} is not in the sweep's folder")
        except DECODE_ERRORS as error:
            raise RunError(
                f"Expected the jobs of a sweep in {path}, found a damaged file ({brief(error)});"
                " delete it: the runs beside it stay as they are."
            ) from error
        return sweep

    def run(self, job: SweepJob) -> RunFolder:
        """The folder of a job."""
        return RunFolder(self.path / job.folder)

    def at_work(self) -> bool:
        """True if a process is working on the sweep."""
        return locked(self.path / ".lock")

    def status(self, file: SweepFile) -> Status:
        """The common status of all jobs.

        Stopped jobs take precedence over failed ones, as the sweep can be continued.
        """
        statuses = {self.run(job).status() for job in file.jobs}
        for status in (Status.RUNNING, Status.KILLED, Status.FAILED):
            if status in statuses:
                return status
        return Status.FINISHED


def arm_of(folder: Path) -> str:
    """The arm of a run in its sweep; "" if the run is not a job of a sweep."""
    file, job = job_of(folder)
    return "" if file is None or job is None else file.arm(job)


def job_of(folder: Path) -> tuple[SweepFile | None, SweepJob | None]:
    """A run's sweep and its job; None for a missing one."""
    file = SweepFolder(folder.parent).read()
    jobs = () if file is None else file.jobs
    return file, next((job for job in jobs if job.folder == folder.name), None)
