"""What a user waits for before anything happens, and how much memory a worker takes."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter, sleep
from typing import Final

from benchmarks.command import RUN, TOOL, empty_folder, finish, interrupt, start
from benchmarks.figure import Effort, Figure

ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 2, Effort.FULL: 4}
SMALL: Final = ("gp.population=6", "gp.generations=50", "world.episode.length=5")
LOOK_EVERY: Final = 0.005  # s
PATIENCE: Final = 120  # s
MB: Final = 1024  # kB


def measure(effort: Effort) -> list[Figure]:
    """`islandgp --help`, a mistake in the configuration, the first generation; then memory."""
    overrides = SMALL if effort is Effort.TINY else ()
    waits: dict[str, Callable[[], float]] = {
        "help_s": lambda: _command(TOOL, "--help"),
        "config_error_s": lambda: _command(RUN, "gp.population=-5", expected=2),
        "first_generation_s": lambda: _first_generation(overrides)[0],
    }
    seconds: dict[str, list[float]] = {name: [] for name in waits}
    for _ in range(ROUNDS[effort]):
        for name, wait in waits.items():
            seconds[name].append(wait())
    meanings = {
        "help_s": "islandgp --help",
        "config_error_s": "python -m islandgp gp.population=-5, until the error is printed",
        "first_generation_s": "python -m islandgp tracking=off, until generation 0 is on disk",
    }
    figures = [Figure(name, median(seconds[name]), "s", meanings[name]) for name in waits]
    _, (resident, proportional) = _first_generation(overrides)
    if resident:
        figures += [
            Figure("worker_mb", resident / MB, "MB", "resident memory of a worker"),
            Figure(
                "worker_own_mb",
                proportional / MB,
                "MB",
                "the same, shared pages split among sharers",
            ),
        ]
    return figures


def _command(command: tuple[str, ...], *arguments: str, expected: int = 0) -> float:
    with empty_folder() as home:
        began = perf_counter()
        finish(start(command, arguments, home), expected)
        return perf_counter() - began


def _first_generation(overrides: tuple[str, ...]) -> tuple[float, tuple[float, float]]:
    """Seconds until generation 0 is on disk; a worker's resident and proportional kB."""
    with empty_folder() as home:
        began = perf_counter()
        process = start(RUN, ["tracking=off", "progress=off", *overrides], home)
        try:
            while not any(file.stat().st_size for file in home.glob("runs/*/*/generations.jsonl")):
                if process.poll() is not None or perf_counter() - began > PATIENCE:
                    raise RuntimeError("the run ended, or stood still, before generation 0")
                sleep(LOOK_EVERY)
            seconds = perf_counter() - began
            memory = _worker_memory(process.pid)
        finally:
            interrupt(process)
        return seconds, memory


def _worker_memory(run: int) -> tuple[float, float]:
    """The largest worker of a run (Linux; 0 elsewhere): workers are the fork server's children."""
    if not Path("/proc/self/smaps_rollup").exists():
        return 0.0, 0.0
    parents = dict(_processes())
    servers = {pid for pid, parent in parents.items() if parent == run}
    sizes = [_memory(pid) for pid, parent in parents.items() if parent in servers]
    return max(sizes, default=(0.0, 0.0))


def _processes() -> list[tuple[int, int]]:
    """(process, its parent) of all that can be seen."""
    processes = []
    for name in os.listdir("/proc"):
        if name.isdecimal():
            try:
                stat = Path(f"/proc/{name}/stat").read_text()
            except OSError:
                continue  # it has ended
            processes.append((int(name), int(stat.rpartition(")")[2].split()[1])))
    return processes


def _memory(pid: int) -> tuple[float, float]:
    """(resident, proportional) kB."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0, 0.0
    kb = {line.split(":")[0]: float(line.split()[1]) for line in lines[1:]}
    return kb["Rss"], kb["Pss"]
