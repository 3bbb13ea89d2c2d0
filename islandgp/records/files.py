"""The small files of a run's folder, and values derived from them."""

from __future__ import annotations

import csv
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import islice
from operator import itemgetter
from pathlib import Path
from time import time
from typing import Annotated, Any, Final

from pydantic import Field

from islandgp.atomic_files import write_atomic
from islandgp.errors import RunError
from islandgp.gp.archive import ArchiveSettings
from islandgp.gp.record import Champion, Cost, IndividualRecord
from islandgp.records.lines import Lines, dump
from islandgp.scoring.classes import Classes
from islandgp.scoring.curriculum import Curriculum


@dataclass(frozen=True, slots=True)
class _Compared:
    """Fields of `evolution.validation.Comparison`; null: no interval of one world."""

    name: str
    mean: float
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class _FrontTree:
    """Fields of `evolution.validation.FrontTree`."""

    nodes: int
    tree: str
    difference: _Compared | None
    chosen: bool


@dataclass(frozen=True, slots=True)
class _Validated:
    """Fields of `evolution.validation.Validation` that are read; null: no interval of one world."""

    worlds: tuple[int, ...]
    mean: float
    low: float | None
    high: float | None
    reached: dict[str, float]
    comparisons: tuple[_Compared, ...] = ()
    violation: float | None = None
    feasible: float | None = None


@dataclass(frozen=True, slots=True)
class _Estimate:
    mean: float
    low: float | None  # null: no interval of one world
    high: float | None


@dataclass(frozen=True, slots=True)
class _Usage:
    """Fields of `scoring.explain.Usage` that are read."""

    worlds: float
    points: float
    loss: _Estimate | None


@dataclass(frozen=True, slots=True)
class _Best:
    generation: int
    record: IndividualRecord  # with the tree before it was shortened
    tree: str  # canonical text
    text: str  # with comments
    validation: _Validated | None
    front: tuple[_FrontTree, ...]  # the shortest first; (): it was not shortened
    changes: tuple[str, ...]
    chosen_in: tuple[int, ...]  # worlds
    usage: tuple[_Usage, ...] = ()  # by node of the tree; (): it was not explained


@dataclass(frozen=True, slots=True)
class RunSummary:
    """The fields of summary.json that are read."""

    champion: _Best
    fittest: Champion  # the individual with the highest fitness in training
    first: dict[str, int | None]  # by milestone
    answers: dict[str, int]
    mostly_fallback: bool
    final_best: float
    final_mean: float
    mean_diversity: float
    generations: Annotated[int, Field(ge=1)]
    seconds: float
    records: str  # digest of all records
    constraints: str | None = None  # in words; None: there are none
    nothing_works: str = ""  # a sentence on what no individual has ever achieved
    learned: tuple[str, ...] = ()  # sentences on what the search has found out


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
    identity: str  # hash of the configuration that determines the records
    tags: dict[str, str]
    domain_code: str = ""  # digest of the domain's source; "" for the package's own domains
    start: str = ""  # digest of the archive that it starts from; "" for none


def validation_mean(summary: Mapping[str, Any]) -> float | None:
    """Mean fitness of a run's best robot in validation worlds, points; None: not validated."""
    validation = summary["champion"]["validation"]
    return None if validation is None else float(validation["mean"])


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedCost(Cost):
    """A line of costs.jsonl."""

    at: Annotated[int, Field(ge=0)]  # ms since 1970, when it was written


PAGE: Final = "run.html"
LONG: Final = "best_long.bt"
"""The best robot's tree before it was shortened."""

RUN_FILES: Final = (
    "about.json",
    "config.yaml",
    "generations.jsonl",
    "generations.sha256",
    "costs.jsonl",
    "checkpoint.json",
    "best.bt",
    LONG,
    "archive.json",
    "lineage.csv",
    PAGE,
    "summary.json",
    "manifest.json",
    "error.txt",
)
"""Files that only the process with the folder's lock writes."""


VALUES: Final[Mapping[str, Callable[[Mapping[str, Any]], Any]]] = {
    "validation_mean": validation_mean,
    "champion_fitness": lambda summary: summary["champion"]["record"]["fitness"],
    "fitness_max": lambda summary: summary["fittest"]["record"]["fitness"],
    "generations": itemgetter("generations"),
    "final_fitness_max": itemgetter("final_best"),
    "final_fitness_mean": itemgetter("final_mean"),
    "mean_diversity": itemgetter("mean_diversity"),
    "seconds": itemgetter("seconds"),
}
"""The values of every run, from its summary."""


def values(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of a finished run, by the columns of `islandgp.load`.

    `validation_mean` is None without validation, `first.<milestone>` without such a robot.
    """
    return {
        **{name: of(summary) for name, of in VALUES.items()},
        **{f"first.{tier}": generation for tier, generation in summary["first"].items()},
        **{f"constraints.{name}": value for name, value in kept_constraints(summary).items()},
    }


FITNESS_KEYS: Final = {"fitness_max": "best", "fitness_mean": "mean", "fitness_sd": "sd"}
"""Keys of a generation's record, by their names in data frames and MLflow."""


def kept_constraints(summary: Mapping[str, Any]) -> dict[str, float]:
    """Feasibility of the best robot in validation worlds; {} without constraints.

    `violation` is that of the counters' means, `feasible` the share of the worlds in which all
    constraints are kept.
    """
    validation = summary["champion"]["validation"] or {}
    names = [name for name in ("violation", "feasible") if validation.get(name) is not None]
    return {name: float(validation[name]) for name in names}


def pretty(value: dict[str, Any]) -> bytes:
    """Indented JSON with a final line break."""
    return (json.dumps(value, indent=1) + "\n").encode()


def answers(decisions: Iterable[Mapping[str, Any]]) -> dict[str, int]:
    """The numbers of decisions: total, by the fallback, and `in_part` by the fallback.

    `decisions`: the `source` and `asked_at` of each guidance.
    """
    sources = Counter(d["source"] for d in decisions if d["asked_at"] is not None)
    fallback = sum(n for source, n in sources.items() if "fallback" in source)
    return {
        "total": sources.total(),
        "fallback": fallback,
        "in_part": fallback - sources["fallback"],
    }


def fallback_share(sources: Mapping[str, int]) -> float:
    """The fallback's share of the decisions that `answers` counts; a part counts half."""
    total = sources.get("total", 0)
    return (sources["fallback"] - sources["in_part"] / 2) / total if total else 0.0


def fallback_words(summaries: Iterable[Mapping[str, Any]]) -> str:
    """The fallback's share of several runs' decisions, as text; "" if it made none."""
    counts: Counter[str] = Counter()
    for summary in summaries:
        counts.update(summary["answers"])
    if not counts["fallback"]:
        return ""
    part = f", {counts['in_part']:,} of them in part" if counts["in_part"] else ""
    return f"{counts['fallback']:,} of {counts['total']:,}{part}"


def mend_costs(costs: Lines, done: int, spent: int, warn: Callable[[str], None]) -> None:
    """Truncates the costs file; replaces damaged lines by 0 s and a share of the episodes.

    Args:
        costs: the file.
        done: number of generations to keep.
        spent: their episodes, as in the checkpoint.
        warn: called with one line if costs were lost.
    """
    rows: list[dict[str, Any] | None] = []
    for i, line in enumerate(islice(costs.whole(), done)):
        try:
            rows.append(costs.value(line, i))
        except RunError:
            rows.append(None)
    rows += [None] * (done - len(rows))
    missing_rows = [i for i, cost in enumerate(rows) if cost is None]
    if not missing_rows:
        costs.cut(done)
        return
    rest = max(0, spent - sum(cost["episodes"] for cost in rows if cost is not None))
    at, llm = int(1000 * time()), dict[str, float]()
    lines = []
    for i, cost in enumerate(rows):
        if cost is None:
            share = rest // len(missing_rows) + (i == missing_rows[-1]) * (rest % len(missing_rows))
            cost = {**asdict(Cost(0.0, 0.0, 0.0, share, 0, llm)), "at": at}
        at, llm = cost["at"], cost["llm"]
        lines.append(dump(cost).encode() + b"\n")
    write_atomic(costs.path, b"".join(lines))
    warn(f"{costs.path}: the seconds of {len(missing_rows)} generations are lost.")


LINEAGE: Final = ("id", "origin", "parents", "mutation", "fitness", "specialist", "tiers")
"""The columns of lineage.csv after the generation."""


class LineageTable:
    """Writes lineage.csv generation by generation, in a hidden file until the run has ended.

    Lists in its columns are separated by spaces.
    """

    def __init__(self, path: Path) -> None:
        """Writes nothing yet; `path` is that of lineage.csv."""
        self._path = path
        self._unfinished = path.with_name(f".{path.name}.{os.getpid()}.tmp")

    def begin(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Begins the table with these generations, given their records as plain values."""
        with self._unfinished.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerow(("generation", *LINEAGE))
        for record in records:
            self.add(record)

    def add(self, record: Mapping[str, Any]) -> None:
        """Adds a generation."""
        generation = record["snapshot"]["generation"]
        with self._unfinished.open("a", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            for i in record["individuals"]:
                row = {**i, "parents": " ".join(i["parents"]), "tiers": " ".join(i["tiers"])}
                rows.writerow([generation, *(row[name] for name in LINEAGE)])

    def write(self) -> None:
        """Gives the table its name."""
        self._unfinished.replace(self._path)

    def discard(self) -> None:
        """Removes a table that was not written."""
        with suppress(OSError):  # there is none, or the folder cannot be used
            self._unfinished.unlink()
