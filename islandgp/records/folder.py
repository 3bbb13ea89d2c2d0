"""A run's folder: the primary record of a run; tracking servers hold copies.

docs/running.md lists its files. A run is finished if there is a summary.json.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import asdict
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from time import time
from typing import Any, Final

import yaml
from filelock import FileLock

from islandgp.atomic_files import damaged, reading, remove_leftovers, usable, write_atomic
from islandgp.errors import BusyError, IslandError, RunError, brief
from islandgp.gate import check_folder, cleaned_values, read_bytes, read_text
from islandgp.gp.record import GenerationRecord, RunState, Step, record_values
from islandgp.plain import from_json, from_plain, read_json, validate_json
from islandgp.records import files, lines, manifest
from islandgp.records.archive_file import NAME as ARCHIVE
from islandgp.records.archive_file import ArchiveFile
from islandgp.records.checkpoint import (
    generation_of,
    read_checkpoint,
    save_state,
    sound_state,
)
from islandgp.records.files import LONG, RunMetadata, RunSummary, pretty
from islandgp.records.lines import Lines, Stamp, chained, generation_lines, stamp
from islandgp.records.locks import locked, take
from islandgp.records.parameters import without_credentials


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
        self._generations = generation_lines(path)
        self._costs = Lines(path / "costs.jsonl", "costs of generations", files.TimedCost)
        self._sums = path / "generations.sha256"
        self._checkpoint = path / "checkpoint.json"
        self._previous = path / "checkpoint.previous.json"
        self._digest = ""  # of the records so far
        self._stamp: Stamp = None  # of generations.jsonl, after the last generation
        self._lineage = files.LineageTable(path / "lineage.csv")  # of the records so far
        self._summary: bytes | None = None  # as this process has written it

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
            for name in files.RUN_FILES:
                remove_leftovers(self.path, f"{name}.*")
            if self.finished():
                return
            (self.path / manifest.NAME).unlink(missing_ok=True)  # of an interrupted end
            write_atomic(self.path / "about.json", pretty(asdict(about)))
            write_atomic(self.path / "config.yaml", config.encode())
            (self.path / "error.txt").unlink(missing_ok=True)

    def close(self) -> None:
        """Unlocks the folder."""
        self._lock.release()
        self._lineage.discard()

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
        """The term for individuals in titles (`classes.agent`); Robot if it cannot be read."""
        with suppress(RunError, AttributeError):
            return str(self.configuration().get("classes", {}).get("agent", "Robot"))
        return "Robot"

    def finished(self) -> bool:
        """True if the run is complete."""
        return (self.path / "summary.json").exists()

    def _as_written(self, name: str) -> Path:
        """A file. Raises RunError for a link in the folder or damage to a finished run."""
        check_folder(self.path)
        has_end = (self.path / manifest.NAME).exists() and not self._has_checkpoint()
        if has_end or self.finished():
            manifest.must_be_as_written(self.path, name)
        return self.path / name

    def _has_checkpoint(self) -> bool:
        """True if the run has a checkpoint, which its end removes after the summary is written."""
        return self._checkpoint.exists() or self._previous.exists()

    def must_be_sound(self, *, page: bool = True) -> None:
        """Raises RunError if a file of a finished run was changed or is missing.

        Files that can be made again may be missing, and further files are allowed. `page`: check
        the run's page as well.
        """
        for file in manifest.damaged_files(self.path):
            added = file.damage is manifest.Damage.ADDED
            if not (added or file.restorable or (file.name == files.PAGE and not page)):
                raise manifest.refused(self.path, file)

    def resume(self, warn: Callable[[str], None] = lambda _: None) -> RunState | None:
        """The state to continue from; None: the run starts at generation 0.

        Records after the checkpoint are cut off. If the newest checkpoint or the record before it
        is damaged, the one before is used. `warn` is called with one line for each damaged file.

        Raises:
            RunError: the run is finished, no checkpoint is sound, records before it are
                damaged or missing, or the folder cannot be used.
        """
        if self.finished():
            raise RunError(
                f"Expected an unfinished run in {self.path}, found it finished; use resume=never"
                " for a new folder beside it."
            )
        with usable(self.path):
            checkpoints = (self._checkpoint, self._previous)
            state = sound_state(checkpoints, self._generations, self._sums, warn)
            done = state.generation if state else 0
            self._generations.cut(done)
            files.mend_costs(self._costs, done, 0 if state is None else state.spent, warn)
            sums = list(lines.digests(self._generations.head(done)))
            self._digest = sums[-1] if sums else ""
            lines.write_digests(self._sums, sums)
            self._stamp = stamp(self._generations.path)
            self._lineage.begin(self._generations.read())
            if state is not None and state.champion is not None:
                self._restore_best(state.champion.record.tree)
        return state

    def restore(self) -> None:
        """Writes missing files of a finished run that can be made from others."""
        with usable(self.path):
            best = self.path / "best.bt"
            if not best.exists():
                self._restore_best(self.summary()["champion"]["text"])
            self._restore_long(self.summary())
            lineage = self.path / "lineage.csv"
            if not lineage.exists():
                self._lineage.begin(self.records())
                self._lineage.write()

    def best_text(self, tree: str) -> str:
        """The content of best.bt for a tree: its domain and its canonical text."""
        about = self.about()
        domain = "" if about is None else about.tags.get("domain", "")
        return f"domain {domain}\n\n{tree}" if domain else tree

    def _restore_best(self, tree: str) -> None:
        best, text = self.path / "best.bt", self.best_text(tree).encode()
        if not best.exists() or read_bytes(best) != text:
            write_atomic(best, text)

    def _restore_long(self, summary: Mapping[str, Any]) -> None:
        """Writes the best robot's tree before it was shortened, if it was."""
        champion = summary["champion"]
        if champion["tree"] != champion["record"]["tree"] and not (self.path / LONG).exists():
            write_atomic(self.path / LONG, self.best_text(champion["record"]["tree"]).encode())

    def append(self, step: Step) -> tuple[dict[str, Any], dict[str, Any]]:
        """Records a generation, then the checkpoint. Raises RunError as `usable`.

        Returns:
            The record and the costs of the generation, as plain values.
        """
        record = record_values(step.record)
        cost = {**asdict(step.cost), "at": int(1000 * time())}
        with usable(self.path):
            if stamp(self._generations.path) != self._stamp:
                self.must_be_as_left()
            line = self._generations.append(record)
            self._stamp = stamp(self._generations.path)
            self._digest = chained(self._digest, line)
            lines.append_digest(self._sums, step.record.snapshot.generation, self._digest)
            self._lineage.add(record)
            self._costs.append(cost)
            if step.champion.generation == step.record.snapshot.generation:
                self._restore_best(step.champion.record.tree)
            if step.state is not None:
                save_state(
                    self._checkpoint, step.state, records=self._digest, previous=self._previous
                )
        return record, cost

    def must_be_as_left(self) -> None:
        """Raises RunError if another program has changed the records while the run was active."""
        digest, size = "", 0
        for line in self._generations.whole():
            digest, size = chained(digest, line), size + len(line)
        present = stamp(self._generations.path)
        if digest != self._digest or size != (0 if present is None else present[0]):
            raise RunError(
                f"Expected the records in {self._generations.path} as this run wrote them, found"
                " them changed by another program; restore them, or use resume=never for a new"
                " folder beside this one."
            )

    def completed_generations(self) -> int:
        """Number of generations that resuming the run will not repeat, >= 0."""
        if self.finished():
            return int(self.summary()["generations"])
        return generation_of(self._checkpoint) or generation_of(self._previous)

    def finish(self, summary: dict[str, Any], archive: ArchiveFile | None = None) -> None:
        """Writes archive, lineage, manifest and summary, and removes the checkpoints.

        Raises:
            RunError: the records are not those that were appended, or the folder cannot be used.
        """
        with usable(self.path):
            self.must_be_as_left()
            if archive is not None:
                write_atomic(self.path / ARCHIVE, archive.to_bytes())
            self._restore_best(summary["champion"]["text"])
            self._restore_long(summary)
            self._lineage.write()
            end = pretty({**summary, "records": self._digest})
            manifest.write_manifest(self.path, end)
            write_atomic(self.path / "summary.json", end)
            self._summary = end
            self._checkpoint.unlink(missing_ok=True)
            self._previous.unlink(missing_ok=True)

    def records(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Generation records from generation `first` on, as plain JSON values. Raises RunError."""
        self._as_written(self._generations.path.name)
        return self._generations.read(first)

    def checked_records(self) -> Iterator[dict[str, Any]]:
        """All generation records; those of a finished run are checked against their checksum.

        Raises:
            RunError: a line holds something else; or, after the last one, the records are not
                those that the run wrote.
        """
        self._as_written(self._generations.path.name)
        last, expected = self.last_record()
        digest, i = "", -1
        for i, line in enumerate(self._generations.whole()):
            yield self._generations.value(line, i)
            digest = chained(digest, line) if i < last else digest
        if i + 1 < last or digest != expected:
            head = self._generations.head(last)
            damage = lines.wrong_record(head, expected, self._sums)
            raise damaged(self._generations.description, self._generations.path, damage)

    def last_record(self) -> tuple[int, str]:
        """The number of records that are complete, and the digest of the last one; "" for none.

        Raises:
            RunError: the summary or the newest checkpoint is damaged, or missing.
        """
        if self.finished():
            summary = self.summary()
            return int(summary["generations"]), str(summary["records"])
        for checkpoint in (self._checkpoint, self._previous):
            if checkpoint.exists():
                state, expected = read_checkpoint(checkpoint)
                return state.generation, expected
        if (n := sum(1 for _ in self._generations.whole())) > 1:
            raise RunError(
                f"Expected a checkpoint beside {n} generations in {self._checkpoint}, found none;"
                " restore it, or use resume=never for a new folder beside this one."
            )
        return 0, ""

    def generations(self) -> Iterator[GenerationRecord]:
        """`checked_records` as GenerationRecord objects. Raises RunError."""
        return (from_plain(GenerationRecord, record) for record in self.checked_records())

    def costs(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """Costs of the generations from `first` on; `at` is ms since 1970."""
        self._as_written(self._costs.path.name)
        return self._costs.read(first)

    def summary(self) -> dict[str, Any]:
        """The content of summary.json. Raises RunError if it is missing or damaged."""
        if self._summary is not None:  # it need not be read again
            return dict(read_json(self._summary))
        file = self._as_written("summary.json")
        with reading("a finished run's summary", file):
            return dict(validate_json(RunSummary, read_bytes(file)))


COPIES: Final = frozenset({"mlartifacts", "mlruns"})
"""Folders with MLflow's artifacts."""


def run_folders(root: Path) -> Iterator[RunFolder]:
    """All run folders in a folder, and itself if it is one, sorted by path.

    A run may lack about.json. Copies of runs in MLflow's artifact folders are left out.
    """
    signs = ("about.json", "generations.sha256", manifest.NAME)
    for folder in sorted({file.parent for name in signs for file in root.rglob(name)}):
        if not is_copy(folder, root):
            yield RunFolder(folder)


def is_copy(folder: Path, root: Path) -> bool:
    """True if a folder in `root` is in one of MLflow's artifact folders."""
    return not COPIES.isdisjoint(folder.relative_to(root).parts)
