"""The file of results: what each benchmark gave last, when and where."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.figure import Effort, Figure, Goal
from islandgp.evaluation.processes import cores

FILE = Path(__file__).parent / "results.json"


@dataclass(frozen=True, slots=True)
class Result:
    """One benchmark's figures."""

    benchmark: str
    figures: tuple[Figure, ...]
    missing: str  # why there are no figures, or ""
    seconds: float  # the measuring took
    date: str  # ISO 8601
    python: str
    cores: int
    load: float  # processes at work in the minute before the first benchmark, on average
    effort: str


def result(
    benchmark: str,
    figures: Sequence[Figure],
    *,
    effort: Effort,
    seconds: float,
    load: float,
    missing: str = "",
) -> Result:
    """Figures with today's date and this machine's nature, but not its name."""
    return Result(
        benchmark=benchmark,
        figures=tuple(figures),
        missing=missing,
        seconds=round(seconds, 1),
        date=datetime.now(UTC).date().isoformat(),
        python=platform.python_version(),
        cores=cores(),
        load=round(load, 2),
        effort=effort.name.lower(),
    )


def load_average() -> float:
    """Processes that want a core, on average over a minute; 0 where nobody knows."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


def save(results: Sequence[Result], file: Path) -> None:
    """Writes results down beside those of other benchmarks that the file has."""
    results_by_name = {r.benchmark: r for r in (load(file) if file.exists() else [])}
    results_by_name |= {r.benchmark: r for r in results}
    plain = [asdict(results_by_name[name]) for name in results_by_name]
    file.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")


def load(file: Path) -> list[Result]:
    """The results in a file."""
    return [_result(plain) for plain in json.loads(file.read_text(encoding="utf-8"))]


def _result(plain: dict[str, Any]) -> Result:
    figures = tuple(
        Figure(**{**f, "goal": Goal(**f["goal"]) if f["goal"] else None}) for f in plain["figures"]
    )
    return Result(**{**plain, "figures": figures})
