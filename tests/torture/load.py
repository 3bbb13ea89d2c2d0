"""Long load: memory, open files and seconds a generation level off."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from time import sleep
from typing import Final

from tests.running.commands import fake
from tests.torture.lab import Lab, start

MEMORY_GROWTH: Final = 1.15  # of the last quarter's largest to the second quarter's, at most
PEAK: Final = 2.0  # of the largest of all to the second quarter's, at most
FILES_GROWTH: Final = 2  # open files more than at a quarter, at most
TIME_GROWTH: Final = 2.0  # of the last quarter's median generation to the first's, at most
FAST: Final = ("supervisor=baseline", "tracking=off", "progress=off", *fake("Instant"))


@dataclass(frozen=True, slots=True)
class Sample:
    """A process at a moment."""

    mib: float  # resident
    files: int  # open
    progress: int  # generations, or runs, so far


def watched(
    process: subprocess.Popen[str], count: Callable[[], int], every: float = 0.5
) -> list[Sample]:
    """Samples of a process until it ends; `done` counts. Raises AssertionError where it fails."""
    samples = []
    while process.poll() is None:
        try:
            status = Path(f"/proc/{process.pid}/status").read_text()
            files = len(os.listdir(f"/proc/{process.pid}/fd"))
        except OSError:
            break  # it has ended between the two looks
        if line := next((li for li in status.splitlines() if li.startswith("VmRSS")), ""):
            samples.append(Sample(int(line.split()[1]) / 1024, files, count()))
        sleep(every)
    output = process.communicate()[0]
    assert process.returncode == 0, output
    return samples


def level(samples: Sequence[Sample], total: int) -> str:
    """Memory and files as a figure. Raises AssertionError where they grow on and on.

    Compared are the second quarter and the last one of the `whole`. At a run's end there is
    more: its best robot is chosen, and statistics are loaded.
    """
    early = [s for s in samples if total / 4 <= s.progress < total / 2]
    late = [s for s in samples if 3 * total / 4 <= s.progress < total]
    assert early, "no sample of the second quarter"
    assert late, "no sample of the last quarter"
    before, after, most = (max(s.mib for s in part) for part in (early, late, samples))
    files = [max(s.files for s in part) for part in (early, late)]
    assert after < MEMORY_GROWTH * before, f"{before:.0f} MiB became {after:.0f}"
    assert most < PEAK * before, f"{before:.0f} MiB became {most:.0f} at the end"
    assert files[1] <= files[0] + FILES_GROWTH, f"{files[0]} open files became {files[1]}"
    memory = f"{before:.0f} MiB, then {after:.0f}, at the end {most:.0f}"
    return f"{memory}; {files[0]} open files, then {files[1]}"


def generations(home: Path) -> int:
    """How many are written of the run below a folder."""
    return sum(f.read_bytes().count(b"\n") for f in (home / "runs").rglob("costs.jsonl"))


def seconds(home: Path) -> list[list[float]]:
    """How long after one another each run's generations were written, s."""
    intervals = []
    for file in sorted((home / "runs").rglob("costs.jsonl")):
        at = [json.loads(line)["at"] for line in file.read_text().splitlines()]
        intervals.append([(b - a) / 1000 for a, b in pairwise(at)])
    return intervals


def steady(pace: Sequence[float]) -> str:
    """First and last quarter's median as a figure. Raises AssertionError where it slows down."""
    n = len(pace)
    before, after = (statistics.median(part) for part in (pace[: n // 4], pace[3 * n // 4 :]))
    assert after < TIME_GROWTH * before, f"{1000 * before:.1f} ms became {1000 * after:.1f}"
    return f"{1000 * before:.1f} ms a generation, then {1000 * after:.1f}"


def long_run(lab: Lab) -> str:
    """3,000 generations of 12 individuals."""
    home = lab.folder()
    arguments = (*FAST, "gp.population=12", "gp.generations=3000")
    samples = watched(start(home, *arguments), lambda: generations(home))
    lab.cases += 1
    return f"{steady(seconds(home)[0])}; {level(samples, 3000)}"


def large_population(lab: Lab) -> str:
    """A population of 1,000 for 40 generations."""
    home = lab.folder()
    arguments = (*FAST, "gp.population=1000", "gp.generations=40")
    samples = watched(start(home, *arguments), lambda: generations(home))
    lab.cases += 1
    return f"{steady(seconds(home)[0])}; {level(samples, 40)}"


def many_runs(lab: Lab) -> str:
    """200 runs in one sweep, tracked by MLflow, in one process."""
    home = lab.folder()
    arguments = [word for word in FAST if word != "tracking=off"]
    small = ("gp.population=4", "gp.generations=3", "seed=range(200)", "-m")
    samples = watched(start(home, *arguments, *small), lambda: generations(home))
    ends = sorted(f.stat().st_mtime for f in (home / "runs").rglob("summary.json"))
    assert len(ends) == 200
    lab.cases += 200
    pace = [b - a for a, b in pairwise(ends)]
    before, after = (statistics.median(part) for part in (pace[:50], pace[-50:]))
    assert after < TIME_GROWTH * before, f"{before:.2f} s a run became {after:.2f}"
    return f"{before:.2f} s a run, then {after:.2f}; {level(samples, 600)}"


LOADS: Final = {
    "3,000 generations of 12": long_run,
    "a population of 1,000, 40 generations": large_population,
    "200 runs in one sweep, with MLflow": many_runs,
}
"""By name, the function that tries it and returns its figures."""
