"""What a run spends on anything but episodes: operators, supervisor, tracking, checkpoints."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import time
from typing import Final, NamedTuple

from benchmarks.command import RUN, empty_folder, finish, start
from benchmarks.figure import Effort, Figure, Goal, at_most
from islandgp.records.folder import RunFolder

SEEDS: Final = {Effort.TINY: 1, Effort.QUICK: 1, Effort.FULL: 2}  # of pairs with MLflow and without
PAPER_S: Final = 36_000  # a run of the paper: ten hours
SHORT: Final = ("gp.population=6", "gp.generations=2", "world.episode.length=5")
EPISODES: Final = ("gp.validation=0",)
"""All episodes are those of generations, whose time the run writes down."""

SHORTER: Final = {Effort.TINY: SHORT, Effort.QUICK: ("gp.generations=11",), Effort.FULL: ()}


class Run(NamedTuple):
    """Where the seconds of one run went."""

    whole: float  # from the first line of the run's folder to the end of the process
    episodes: float  # in which episodes ran
    operators: float  # selection, variation and book-keeping in the loop
    supervision: float  # waiting for advice
    command: float  # from the start of the process to its end

    @property
    def rest(self) -> float:
        """Records, checkpoints, tracking, and the end of the process."""
        return self.whole - self.episodes - self.operators - self.supervision


def measure(effort: Effort) -> list[Figure]:
    """Whole runs of the default experiment as a user starts them, with and without MLflow."""
    with empty_folder() as home:
        first = _run(home, "tracking=mlflow", "name=first", *SHORT)
        off = _run(home, "tracking=off", "name=off", *SHORTER[effort])
        mlflow = _run(home, "tracking=mlflow", "name=mlflow", *SHORTER[effort])
        shares = [_share_of_mlflow(home, seed, SHORTER[effort]) for seed in range(SEEDS[effort])]
    # MLflow's process works while episodes run and takes a core from them, so a tracked
    # run is held against the episodes of the untracked one.
    goal = at_most(5.0) if effort is Effort.FULL else None
    return [
        _share("overhead_share_off", off, off.episodes, "tracking=off", goal),
        _share("overhead_share_mlflow", mlflow, off.episodes, "tracking=mlflow, the default", goal),
        Figure(
            "mlflow_share",
            median(shares),
            "%",
            "what tracking=mlflow takes of a default run, its validation included; median of seeds",
            at_most(10.0) if effort is Effort.FULL else None,
        ),
        Figure("episodes_s", off.episodes, "s", "episodes, with the workers' start"),
        Figure("operators_s", off.operators, "s", "selection, variation, records"),
        Figure("supervision_s", off.supervision, "s", "waiting for advice"),
        Figure("rest_s", off.rest, "s", "checkpoints, files, end of the process"),
        Figure("run_s_off", off.whole, "s", "all of these: the run, tracking=off"),
        Figure("run_s_mlflow", mlflow.whole, "s", "the run, tracking=mlflow"),
        Figure(
            "new_store_s",
            first.rest,
            "s",
            "the rest of a run of 2 generations that makes a new MLflow store, import and all",
        ),
        Figure("command_s", mlflow.command, "s", "the command, tracking=mlflow"),
        Figure("paper_ratio", PAPER_S / off.whole, "", "the paper's 36,000 s a run / run_s_off"),
    ]


def _share(name: str, run: Run, episodes: float, condition: str, goal: Goal | None) -> Figure:
    value = 100 * (1 - episodes / run.whole)
    return Figure(
        name, value, "%", f"everything but episodes, in percent of a run, {condition}", goal
    )


def _share_of_mlflow(home: Path, seed: int, shorter: tuple[str, ...]) -> float:
    """Percent of the seconds of a run of a seed, beside the same run without tracking."""
    off, on = (
        _run(home, f"tracking={t}", f"name={t}-{seed}", f"seed={seed}", *shorter, fixed=())
        for t in ("off", "mlflow")
    )
    return 100 * (1 - off.whole / on.whole)


def _run(home: Path, *words: str, fixed: tuple[str, ...] = EPISODES) -> Run:
    name = next(word.removeprefix("name=") for word in words if word.startswith("name="))
    began = time()
    finish(start(RUN, [*words, *fixed, "progress=off"], home))
    ended = time()
    (summary,) = home.glob(f"runs/{name}/*/summary.json")
    folder = RunFolder(summary.parent)
    about, costs = folder.about(), list(folder.costs())
    assert about is not None
    return Run(
        whole=ended - about.started / 1000,
        episodes=sum(cost["evaluation"] for cost in costs),
        operators=sum(cost["operators"] for cost in costs),
        supervision=sum(cost["supervision"] for cost in costs),
        command=ended - began,
    )
