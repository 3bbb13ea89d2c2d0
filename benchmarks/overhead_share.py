"""What a run spends on anything but episodes: operators, supervisor, tracking, checkpoints."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from time import time
from typing import Final, NamedTuple

from benchmarks.command import RUN, empty_folder, finish, start
from benchmarks.figure import Effort, Figure, Goal, at_most
from islandgp.records.folder import RunFolder

ROUNDS: Final = {Effort.TINY: 1, Effort.QUICK: 1, Effort.FULL: 3}
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
    off, mlflow = [], []
    with empty_folder() as home:
        first = _run(home, "tracking=mlflow", "name=first", *SHORT)
        for i in range(ROUNDS[effort]):
            off.append(_run(home, "tracking=off", f"name=off{i}", *SHORTER[effort]))
            mlflow.append(_run(home, "tracking=mlflow", f"name=mlflow{i}", *SHORTER[effort]))
        shares = [_share_of_mlflow(home, seed, SHORTER[effort]) for seed in range(ROUNDS[effort])]
    # MLflow's process works while episodes run and takes a core from them, so a tracked
    # run is held against the episodes of the untracked one.
    episodes = median(run.episodes for run in off)
    goal = at_most(5.0) if effort is Effort.FULL else None
    return [
        _share("overhead_share_off", off, episodes, "tracking=off", goal),
        _share("overhead_share_mlflow", mlflow, episodes, "tracking=mlflow, the default", goal),
        Figure(
            "mlflow_share",
            median(shares),
            "%",
            "what tracking=mlflow takes of a default run, its validation included; median of seeds",
            at_most(10.0) if effort is Effort.FULL else None,
        ),
        _seconds("episodes_s", [r.episodes for r in off], "episodes, with the workers' start"),
        _seconds("operators_s", [r.operators for r in off], "selection, variation, records"),
        _seconds("supervision_s", [r.supervision for r in off], "waiting for advice"),
        _seconds("rest_s", [r.rest for r in off], "checkpoints, files, end of the process"),
        _seconds("run_s_off", [r.whole for r in off], "all of these: the run, tracking=off"),
        _seconds("run_s_mlflow", [r.whole for r in mlflow], "the run, tracking=mlflow"),
        _seconds(
            "new_store_s",
            [first.rest],
            "the rest of a run of 2 generations that makes a new MLflow store, import and all",
        ),
        _seconds("command_s", [r.command for r in mlflow], "the command, tracking=mlflow"),
    ]


def _share(name: str, runs: list[Run], episodes: float, said: str, goal: Goal | None) -> Figure:
    value = median(100 * (1 - episodes / run.whole) for run in runs)
    return Figure(name, value, "%", f"everything but episodes, in percent of a run, {said}", goal)


def _share_of_mlflow(home: Path, seed: int, shorter: tuple[str, ...]) -> float:
    """Percent of the seconds of a run of a seed, beside the same run without tracking."""
    off, on = (
        _run(home, f"tracking={t}", f"name={t}-{seed}", f"seed={seed}", *shorter, fixed=())
        for t in ("off", "mlflow")
    )
    return 100 * (1 - off.whole / on.whole)


def _seconds(name: str, values: list[float], what: str) -> Figure:
    return Figure(name, median(values), "s", what)


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
