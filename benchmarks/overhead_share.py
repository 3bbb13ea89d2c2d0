"""What a run spends on anything but episodes: operators, supervisor, tracking, checkpoints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import time
from typing import Final, NamedTuple

from benchmarks.command import empty_folder, finish, start_in_terminal
from benchmarks.figure import Effort, Figure, at_most
from islandgp.records.folder import RunFolder

SEEDS: Final = {Effort.TINY: 1, Effort.QUICK: 1, Effort.FULL: 2}  # of pairs with MLflow and without
REPEATS: Final = {
    Effort.TINY: 1,
    Effort.QUICK: 1,
    Effort.FULL: 5,
}  # of such a pair without validation
PAPER_S: Final = 36_000  # a run of the paper: ten hours
SHORT: Final = ("gp.population=6", "gp.generations=2", "world.episode.length=5")
EPISODES: Final = ("gp.validation=0",)
"""All episodes are those of generations, whose time the run writes down."""

SHORTER: Final = {Effort.TINY: SHORT, Effort.QUICK: ("gp.generations=11",), Effort.FULL: ()}


class Run(NamedTuple):
    """Where the seconds of one run went."""

    total: float  # from the first line of the run's folder to the end of the process
    episodes: float  # in which episodes ran
    operators: float  # selection, variation and book-keeping in the loop
    supervision: float  # waiting for advice
    command: float  # from the start of the process to its end

    @property
    def rest(self) -> float:
        """Records, checkpoints, page, tracking, and the end of the process."""
        return self.total - self.episodes - self.operators - self.supervision


def measure(effort: Effort) -> list[Figure]:
    """Whole runs of the default experiment as a user starts them, with and without MLflow."""
    with empty_folder() as home:
        first = _run(home, "tracking=mlflow", "name=first", *SHORT, *EPISODES)
        numbers = range(REPEATS[effort])
        trained = [_pair(home, f"train{k}", *SHORTER[effort], *EPISODES) for k in numbers]
        seeds = range(SEEDS[effort])
        pairs = [_pair(home, f"{k}", f"seed={k}", *SHORTER[effort]) for k in seeds]
    off, mlflow = (sorted(runs)[len(runs) // 2] for runs in zip(*trained, strict=True))
    # MLflow's thread may take a core from the episodes, so a tracked run is held against the
    # episodes of the untracked one.
    goal = at_most(10.0) if effort is Effort.FULL else None
    return [
        _share(
            "overhead_share_off",
            [100 * (1 - run.episodes / run.total) for run, _ in trained],
            "tracking=off",
        ),
        _share(
            "overhead_share_mlflow",
            [100 * (1 - run.episodes / tracked.total) for run, tracked in trained],
            "tracking=mlflow, the default",
        ),
        Figure(
            "mlflow_share",
            median(100 * (1 - pair[0].total / pair[1].total) for pair in pairs),
            "%",
            "what tracking=mlflow takes of a default run until the prompt, its validation included;"
            " median of seeds",
        ),
        Figure("episodes_s", off.episodes, "s", "episodes, with the workers' start"),
        Figure("operators_s", off.operators, "s", "selection, variation, records"),
        Figure("supervision_s", off.supervision, "s", "waiting for advice"),
        Figure("rest_s", off.rest, "s", "checkpoints, files, end of the process"),
        Figure(
            "run_s_off",
            off.total,
            "s",
            "all of these: the run without validation, tracking=off",
        ),
        Figure("run_s_mlflow", mlflow.total, "s", "the same, tracking=mlflow"),
        Figure(
            "new_store_s",
            first.rest,
            "s",
            "the rest of a run of 2 generations that makes a new MLflow store, import and all",
        ),
        Figure(
            "command_s_off",
            median(pair[0].command for pair in pairs),
            "s",
            "the default command from start to end, its validation included, tracking=off;"
            " median of seeds",
        ),
        Figure(
            "command_s_mlflow",
            median(pair[1].command for pair in pairs),
            "s",
            "the same, tracking=mlflow, until all is sent",
            goal,
        ),
        Figure("paper_ratio", PAPER_S / off.total, "", "the paper's 36,000 s a run / run_s_off"),
    ]


def _share(name: str, values: Sequence[float], condition: str) -> Figure:
    meaning = f"everything but episodes, in percent of a run, {condition}; median of runs"
    return Figure(name, median(values), "%", meaning)


def _pair(home: Path, name: str, *overrides: str) -> tuple[Run, Run]:
    """A run without tracking, and the same with MLflow."""
    off, on = (
        _run(home, f"tracking={t}", f"name={t}-{name}", *overrides) for t in ("off", "mlflow")
    )
    return off, on


def _run(home: Path, *overrides: str) -> Run:
    name = next(word.removeprefix("name=") for word in overrides if word.startswith("name="))
    began = time()
    finish(start_in_terminal([*overrides, "progress=off"], home))
    ended = time()
    (summary,) = home.glob(f"runs/{name}/*/summary.json")
    folder = RunFolder(summary.parent)
    about, costs = folder.about(), list(folder.costs())
    assert about is not None
    return Run(
        total=ended - about.started / 1000,
        episodes=sum(cost["evaluation"] for cost in costs),
        operators=sum(cost["operators"] for cost in costs),
        supervision=sum(cost["supervision"] for cost in costs),
        command=ended - began,
    )
