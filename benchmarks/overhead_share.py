"""What a run spends on anything but episodes: operators, supervisor, tracking, checkpoints."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import time
from typing import Final, NamedTuple

from benchmarks.command import empty_folder, finish, start
from benchmarks.figure import Effort, Figure, at_most
from islandgp.tracking.folder import RunFolder

ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 1, Effort.FULL: 3}
SHORTER: Final = {
    Effort.TINY: ("gp.population=6", "gp.generations=2", "world.episode.length=5"),
    Effort.QUICK: ("gp.generations=11",),
    Effort.FULL: (),
}
TRACKING: Final = ("off", "mlflow")


class Run(NamedTuple):
    """Where the seconds of one run went."""

    whole: float  # s from the first line of the run's folder to the end of the process
    episodes: float  # s in which episodes ran
    operators: float  # s
    supervision: float  # s
    command: float  # s from the start of the process to its end

    @property
    def share(self) -> float:
        """Everything but episodes, in percent of the run."""
        return 100 * (1 - self.episodes / self.whole)


def measure(effort: Effort) -> list[Figure]:
    """Whole runs of the default experiment as a user starts them, both kinds in turns."""
    runs: dict[str, list[Run]] = {tracking: [] for tracking in TRACKING}
    for _ in range(ROUNDS[effort]):
        for tracking in TRACKING:
            runs[tracking].append(_run(tracking, SHORTER[effort]))
    figures = []
    for tracking, found in runs.items():
        said = f"tracking={tracking}"
        rest = median(r.whole - r.episodes - r.operators - r.supervision for r in found)
        figures += [
            Figure(
                f"overhead_share_{tracking}",
                median(r.share for r in found),
                "%",
                f"everything but episodes, in percent of the run, {said}",
                at_most(5.0) if effort is Effort.FULL else None,
            ),
            _seconds("whole", tracking, [r.whole for r in found], "the run, to its process's end"),
            _seconds("operators", tracking, [r.operators for r in found], "selection, variation"),
            _seconds("supervision", tracking, [r.supervision for r in found], "waiting for advice"),
            Figure(
                f"rest_s_{tracking}", rest, "s", f"records, checkpoints, tracking, end, {said}"
            ),
            _seconds(
                "command", tracking, [r.command for r in found], "the command, imports included"
            ),
        ]
    return figures


def _seconds(name: str, tracking: str, values: list[float], what: str) -> Figure:
    return Figure(f"{name}_s_{tracking}", median(values), "s", f"{what}, tracking={tracking}")


def _run(tracking: str, words: tuple[str, ...]) -> Run:
    with empty_folder() as home:
        began = time()
        finish(start("islandgp", [f"tracking={tracking}", "progress=off", *words], home))
        ended = time()
        folder = RunFolder(_only_run(home))
        about, costs = folder.about(), list(folder.costs())
    assert about is not None
    return Run(
        whole=ended - about.started / 1000,
        episodes=sum(cost["evaluation"] for cost in costs),
        operators=sum(cost["operators"] for cost in costs),
        supervision=sum(cost["supervision"] for cost in costs),
        command=ended - began,
    )


def _only_run(home: Path) -> Path:
    (found,) = home.glob("runs/*/*/summary.json")
    return found.parent
