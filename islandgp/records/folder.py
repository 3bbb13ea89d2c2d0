"""A run's folder: the primary record of a run; tracking servers hold copies.

docs/running.md lists its files. A run is finished if there is a summary.json.
"""

from __future__ import annotations

import hashlib
import json
import traceback
from collections.abc import Iterator
from contextlib import suppress
from copy import deepcopy
from dataclasses import asdict, replace
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from time import time
from typing import Any, Final

import yaml
from filelock import FileLock, Timeout

from islandgp.atomic_files import reading, remove_leftovers, usable, write_atomic
from islandgp.errors import BusyError, IslandError, RunError, brief
from islandgp.gate import check_folder, cleaned_values, read_bytes, read_text
from islandgp.gp.record import GenerationRecord, RunState, Step, record_values
from islandgp.plain import from_json, from_plain, to_json, validate_json
from islandgp.records import files, manifest
from islandgp.records.archive_file import NAME as ARCHIVE
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.checkpoint import generation_of, recorded, save_state
from islandgp.records.files import LONG, RunMetadata, RunSummary, pretty
from islandgp.records.parameters import without_credentials
from islandgp.scoring.generation_stats import GenerationStats
from islandgp.text import in_its_domain


class Status(StrEnum):
    """Status of a run, in MLflow's terms."""

    RUNNING = "RUNNING"  # a process is working on it
    FINISHED = "FINISHED"  # it is complete
    FAILED = "FAILED"  # an error stopped it
    KILLED = "KILLED"  # it was stopped, or its process died


@lru_cache(maxsize=16)
def _configuration(text: str) -> dict[str, Any]:
    """The values of a run's configuration, cached because parsing is slow; do not modify them.

    Raises:
        ValueError: a field that readers use is missing or has another type.
    """
    try:
        config = cleaned_values(yaml.load(text, Loader=_LOADER))
    except yaml.YAMLError as error:
        raise ValueError(brief(error)) from error
    from_json(files.RecordedConfiguration, config)
    return dict(config)


_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The loader of the C library, unless PyYAML was built without it; it is seven times as fast."""


class RunFolder:
    """Writes and reads one run's folder; only one process writes at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = FileLock(path / ".lock")
        self._generations = files.generation_lines(path)
        self._costs = files.cost_lines(path)
        self._checkpoint = path / "checkpoint.json"
        self._digest = hashlib.sha256()  # of the records that this process has read and written

    def open(self, config: str, about: RunMetadata) -> None:
        """Locks the folder for this process and writes about.json and config.yaml (YAML text).

        The files of a finished run are not changed.

        Raises:
            BusyError: another process is writing to the folder.
            RunError: the folder cannot be written.
        """
        with usable(self.path):
            check_folder(self.path)
            busy = BusyError(
                f"Expected to be the only process that writes to {self.path}, found another run at"
                " work there; wait for it, or give this one another name=..."
            )
            take(self._lock, self.path, busy)
            remove_leftovers(self.path)
            if self.finished():
                return
            (self.path / manifest.NAME).unlink(missing_ok=True)  # of an interrupted end
            write_atomic(self.path / "about.json", pretty(asdict(about)))
            write_atomic(self.path / "config.yaml", config.encode())
            (self.path / "error.txt").unlink(missing_ok=True)

    def close(self) -> None:
        """Unlocks the folder."""
        self._lock.release()

    def fail(self, error: Exception) -> None:
        """Writes error.txt, the message and the traceback, unless the disk is full."""
        trace = "".join(traceback.format_exception(error))
        text = f"{error}\n\n{trace}" if isinstance(error, IslandError) else trace
        with suppress(OSError):
            self.path.mkdir(parents=True, exist_ok=True)
            raw = without_credentials(text).encode(errors="replace")
            write_atomic(self.path / "error.txt", raw)

    def error(self) -> str:
        """The text of error.txt, or ""."""
        file = self.path / "error.txt"
        return read_text(file) if file.exists() else ""

    def reason(self) -> str:
        """The first line of the run's error message, or its traceback's last line; or ""."""
        text = [line for line in self.error().splitlines() if line.strip()]
        return "" if not text else text[-1] if text[0].startswith("Traceback") else text[0]

    def status(self) -> Status:
        """The status of the run, also if its process has died."""
        check_folder(self.path)
        if self.finished():
            return Status.FINISHED
        if locked(self.path / ".lock"):
            return Status.RUNNING
        return Status.FAILED if self.error() else Status.KILLED

    def must_be_sound(self) -> None:
        """Raises RunError if a file of a finished run was changed or is missing."""
        manifest.must_be_sound(self.path)

    def about(self) -> RunMetadata | None:
        """The content of about.json; None if there is none. Raises RunError if damaged."""
        file = self._as_written("about.json")
        if not file.exists():
            return None
        with reading("the metadata of a run", file):
            return RunMetadata(**validate_json(RunMetadata, read_bytes(file)))

    def begun(self) -> bool:
        """True if the folder has a run. Raises RunError if it cannot be read."""
        with usable(self.path):
            return (self.path / "config.yaml").exists()

    def config(self) -> str | None:
        """The content of config.yaml; None if there is none."""
        file = self._as_written("config.yaml")
        return read_bytes(file).decode() if file.exists() else None

    def configuration(self) -> dict[str, Any]:
        """The configuration as plain values; {} if there is none. Raises RunError if damaged."""
        with reading("a run's configuration", self.path / "config.yaml"), usable(self.path):
            text = self.config()
            return {} if text is None else deepcopy(_configuration(text))

    @property
    def agent(self) -> str:
        """The term for individuals in titles."""
        return str(self.configuration()["classes"].get("agent", "Robot"))

    def finished(self) -> bool:
        """True if the run is complete."""
        return (self.path / "summary.json").exists()

    def _as_written(self, name: str) -> Path:
        """A file. Raises RunError for a link in the folder or damage to a finished run."""
        check_folder(self.path)
        has_end = (self.path / manifest.NAME).exists() and not self._checkpoint.exists()
        if has_end or self.finished():
            manifest.must_be_sound(self.path, name)
        return self.path / name

    def verified(self) -> str:
        """The run in a few words, once its files or, before its end, its records are checked.

        Raises:
            RunError: a file is damaged.
        """
        check_folder(self.path)
        if self.finished() and (damage := manifest.damaged_files(self.path)):
            raise RunError("; ".join(f"{name}: {what}" for name, what in damage.items()))
        self.configuration()
        if not self.about():
            raise RunError("about.json: missing")
        for _ in zip(self.records(), self.costs(), strict=False):
            pass
        end = "finished" if self.finished() else "unfinished"
        return f"{self.completed_generations()} generations, {end}"

    def resume(self) -> RunState | None:
        """The state to continue from; None: the run starts at generation 0.

        Records after the checkpoint are cut off.

        Raises:
            RunError: the run is finished, the checkpoint or a record before it is damaged or
                missing, or the folder cannot be used.
        """
        if self.finished():
            raise RunError(
                f"Expected an unfinished run in {self.path}, found it finished; use resume=never"
                " for a new folder beside it."
            )
        with usable(self.path):
            state, lines = recorded(self._checkpoint, self._generations)
            self._digest = hashlib.sha256(self._generations.cut(len(lines)))
            self._costs.cut(len(lines))
            if state is None:
                return None
            if state.champion is not None:
                self._restore_best(state.champion.record.tree)
            history = (from_plain(GenerationStats, r["snapshot"]) for r in self._generations.read())
            return replace(state, history=tuple(history))

    def best_text(self, tree: str) -> str:
        """The content of best.bt for a tree: its domain and its canonical text."""
        about = self.about()
        return in_its_domain("" if about is None else about.tags.get("domain", ""), tree)

    def _restore_best(self, tree: str) -> None:
        best, text = self.path / "best.bt", self.best_text(tree).encode()
        if not best.exists() or read_bytes(best) != text:
            write_atomic(best, text)

    def append(self, step: Step) -> tuple[dict[str, Any], dict[str, Any]]:
        """Records a generation, then the checkpoint. Raises RunError as `usable`.

        Returns:
            The record and the costs of the generation, as plain values.
        """
        record = record_values(step.record)
        cost = {**asdict(step.cost), "at": int(1000 * time())}
        with usable(self.path):
            self._digest.update(self._generations.append(record))
            self._costs.append(cost)
            if step.champion.generation == step.record.snapshot.generation:
                self._restore_best(step.champion.record.tree)
            if step.state is not None:
                digest = self._digest.hexdigest()
                save_state(self._checkpoint, step.state, records=digest)
        return record, cost

    def completed_generations(self) -> int:
        """Number of generations that resuming the run will not repeat, >= 0."""
        if self.finished():
            return int(self.summary()["generations"])
        return generation_of(self._checkpoint)

    def finish(self, summary: RunSummary, archive: ArchiveFile | None = None) -> None:
        """Writes archive, lineage, manifest and summary, and removes the checkpoint.

        Raises:
            RunError: the records are not those that were appended, or the folder cannot be used.
        """
        with usable(self.path):
            file = self._generations.path
            present = read_bytes(file) if file.exists() else b""
            if hashlib.sha256(present).digest() != self._digest.digest():
                raise RunError(
                    f"Expected the records in {file} as this run wrote them, found them changed by"
                    " another program; restore them, or use resume=never for a new folder beside"
                    " this one."
                )
            # As they are what this run wrote, they need no other check.
            records = map(json.loads, present.splitlines())
            best = summary.champion
            contents = {
                "best.bt": self.best_text(best.text).encode(),
                "lineage.csv": files.lineage_table(records),
                **({} if archive is None else {ARCHIVE: archive.to_bytes()}),
            }
            if best.tree != best.record.tree:
                contents[LONG] = self.best_text(best.record.tree).encode()
            for name, content in contents.items():
                write_atomic(self.path / name, content)
            end = pretty(to_json(summary))
            manifest.write_manifest(self.path, end)
            write_atomic(self.path / "summary.json", end)
            self._checkpoint.unlink(missing_ok=True)

    def records(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Generation records from generation `first` on, as plain JSON values.

        Raises:
            RunError: they are not those that the run wrote, or a line holds something else.
        """
        self._as_written(self._generations.path.name)
        if not self.finished():
            try:
                recorded(self._checkpoint, self._generations)
            except (RunError, FileNotFoundError):
                if not self.finished():  # else it has ended meanwhile
                    raise
        return self._generations.read(first)

    def generations(self) -> Iterator[GenerationRecord]:
        """`records` as GenerationRecord objects. Raises RunError."""
        return (from_plain(GenerationRecord, record) for record in self.records())

    def costs(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Costs of the generations from `first` on; `at` is ms since 1970."""
        self._as_written(self._costs.path.name)
        return self._costs.read(first)

    def archive(self) -> ArchiveFile:
        """The content of archive.json. Raises RunError if it is missing or damaged."""
        file = self._as_written(ARCHIVE)
        if not file.exists():
            raise RunError(
                f"Expected the archive of a finished run in {file}, found none; give the folder of"
                " a run that has ended."
            )
        with reading("an archive", file, "give the archive of another run"):
            return ArchiveFile.of(read_bytes(file))

    def summary(self) -> dict[str, Any]:
        """The content of summary.json. Raises RunError if it is missing or damaged."""
        file = self._as_written("summary.json")
        with reading("a finished run's summary", file):
            return dict(validate_json(RunSummary, read_bytes(file)))


def take(lock: FileLock, folder: Path, busy: RunError) -> None:
    """Creates a folder and acquires its lock. Raises `busy` if another process holds it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        # `locked` of another process may hold it for a moment.
        lock.acquire(timeout=1, poll_interval=0.05)
    except Timeout:
        raise busy from None


def locked(path: Path) -> bool:
    """True if a process holds the lock file."""
    if not path.exists():
        return False
    try:
        with FileLock(path, timeout=0):
            return False
    except Timeout:
        return True


COPIES: Final = frozenset({"mlartifacts", "mlruns"})  # folders with MLflow's artifacts


def run_folders(root: Path) -> Iterator[RunFolder]:
    """All run folders in a folder, and itself if it is one, sorted by path.

    A run may lack about.json. Copies of runs in MLflow's artifact folders are left out.
    """
    signs = ("about.json", "generations.jsonl", manifest.NAME)
    for folder in sorted({file.parent for name in signs for file in root.rglob(name)}):
        if not is_copy(folder, root):
            yield RunFolder(folder)


def is_copy(folder: Path, root: Path) -> bool:
    """True if a folder in `root` is in one of MLflow's artifact folders."""
    return not COPIES.isdisjoint(folder.relative_to(root).parts)
