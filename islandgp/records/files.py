"""The content of the files of a run's folder, and append-only files of JSON lines."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field

from islandgp.atomic_files import reading, write_atomic
from islandgp.errors import RunError
from islandgp.evolution.validation import Best
from islandgp.gate import MAX_BYTES, check_length, opened
from islandgp.gp.archive import ArchiveSettings
from islandgp.gp.record import Champion, Cost, GenerationRecord
from islandgp.plain import validate_json
from islandgp.scoring.classes import Classes
from islandgp.scoring.curriculum import Curriculum


def dump(value: Any) -> str:
    """JSON on one line; equal values have equal bytes."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


@dataclass(frozen=True, slots=True)
class Lines:
    """A file of JSON lines, which need not exist yet."""

    path: Path
    description: str  # plural noun for the lines in messages
    kind: type  # the dataclass whose fields a line has; it may have others

    def append(self, value: dict[str, Any]) -> bytes:
        """Appends a line and flushes it to the disk; returns the line with its line break."""
        line = dump(value).encode() + b"\n"
        with self.path.open("ab") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        return line

    def read(self, first: int = 0) -> Iterator[dict[str, Any]]:
        """The values from line `first` on, without an incomplete last line. Raises as `value`."""
        for i, line in enumerate(islice(self.whole(), first, None), first):
            yield self.value(line, i)

    def value(self, line: bytes, i: int) -> dict[str, Any]:
        """The value of line `i`. Raises RunError if it is damaged."""
        with reading(f"{self.description} in line {i + 1}", self.path):
            return dict(validate_json(self.kind, line))

    def whole(self) -> Iterator[bytes]:
        """The complete lines, with their line breaks."""
        if not self.path.exists():
            return
        with opened(self.path) as lines:
            while line := lines.readline(MAX_BYTES + 1):
                check_length(self.path, line)
                if line.endswith(b"\n"):
                    yield line

    def head(self, n: int) -> list[bytes]:
        """The first `n` complete lines. Raises RunError if there are fewer."""
        lines = list(islice(self.whole(), n))
        if len(lines) < n:
            raise RunError(
                f"Expected {n} generations in {self.path}, found {len(lines)};"
                " delete the run's folder or use resume=never."
            )
        return lines

    def cut(self, n: int) -> bytes:
        """Truncates the file after `n` lines and returns them. Raises RunError for fewer."""
        keep = b"".join(self.head(n))
        if not self.path.exists() or self.path.stat().st_size != len(keep):
            write_atomic(self.path, keep)
        return keep


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Content of summary.json."""

    champion: Best
    fittest: Champion  # the individual with the highest fitness in training
    first: dict[str, int | None]  # by milestone
    answers: dict[str, int]
    mostly_fallback: bool
    final_fitness_max: float  # points
    final_fitness_mean: float
    mean_diversity: float
    generations: Annotated[int, Field(ge=1)]
    seconds: float
    constraints: str | None = None  # in words; None: there are none
    nothing_works: str = ""  # a sentence on what no individual has ever achieved
    learned: tuple[str, ...] = ()  # sentences on what the search has found out
    stopped: str = ""  # the target of `stop` that ended the run


@dataclass(frozen=True, slots=True)
class _Named:
    name: str


@dataclass(frozen=True, slots=True)
class _Factory:
    factory: str


@dataclass(frozen=True, slots=True)
class _Genetics:
    population: int
    generations: int
    episodes: int
    shared_seed: bool


@dataclass(frozen=True, slots=True)
class RecordedConfiguration:
    """The fields of config.yaml that readers of a run use, apart from those of its domain."""

    name: str
    seed: int
    domain: _Factory
    search: _Named
    supervisor: _Named
    gp: _Genetics
    world: dict[str, Any]
    rewards: dict[str, Any]
    curriculum: Curriculum
    classes: Classes
    archive: ArchiveSettings
    library: dict[str, Any]


@dataclass(frozen=True, slots=True)
class RunMetadata:
    """Identity and provenance of a run."""

    id: str  # unique; the same after each resumption
    title: str  # of the run in displays
    home: str  # absolute path of the folder in which the command was given
    command: str  # that starts the run, or continues it
    started: int  # ms since 1970
    tags: dict[str, str]
    domain_code: str = ""  # digest of the domain's source; "" for the package's own domains
    start: str = ""  # digest of the archive that it starts from; "" for none


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedCost(Cost):
    """A line of costs.jsonl."""

    at: Annotated[int, Field(ge=0)]  # ms since 1970, when it was written


PAGE: Final = "run.html"
LONG: Final = "best_long.bt"  # the best robot's tree before it was shortened


def pretty(value: dict[str, Any]) -> bytes:
    """Indented JSON with a final line break."""
    return (json.dumps(value, indent=1) + "\n").encode()


def generation_lines(folder: Path) -> Lines:
    """The file of a run's generation records."""
    return Lines(folder / "generations.jsonl", "generation records", GenerationRecord)


def cost_lines(folder: Path) -> Lines:
    """The file of the costs of a run's generations."""
    return Lines(folder / "costs.jsonl", "costs of generations", TimedCost)


LINEAGE: Final = ("id", "origin", "parents", "mutation", "fitness", "specialist", "tiers")
"""The columns of lineage.csv after the generation. Lists are separated by spaces."""


def lineage_table(records: Iterable[Mapping[str, Any]]) -> bytes:
    """The content of lineage.csv, from the generation records as plain values."""
    text = StringIO(newline="")
    rows = csv.writer(text)
    rows.writerow(("generation", *LINEAGE))
    for record in records:
        for i in record["individuals"]:
            row = {**i, "parents": " ".join(i["parents"]), "tiers": " ".join(i["tiers"])}
            rows.writerow([record["snapshot"]["generation"], *(row[name] for name in LINEAGE)])
    return text.getvalue().encode()
