"""The best trees of a finished run or sweep, compared in worlds that neither made nor chose any."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from islandgp.compare.champions import (
    Make,
    in_worlds,
    library_trees,
    perturbed_problem,
    summarised,
)
from islandgp.errors import ConfigError, RunError
from islandgp.evaluation.base import Problem
from islandgp.evolution.candidates import Candidate, by_fitness
from islandgp.evolution.validation import validate, validation_seeds
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import TASK
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import Constraints, recorded_constraints
from islandgp.seeding import Stream
from islandgp.statistics import mean_interval

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

EFFORT: Final = 20
"""Episodes of successive halving for each of --worlds."""


def finished_runs(path: Path) -> tuple[list[RunFolder], list[str]]:
    """The run in a folder, or those of the sweep, and the names of unfinished ones.

    Raises:
        RunError: there is none, or the fitness of two runs is not comparable.
    """
    one = RunFolder(path)
    if one.begun():
        one.about()  # a finished run that has lost its summary is damaged
    below = [RunFolder(child) for child in sorted(path.iterdir())] if path.is_dir() else []
    runs = [run for run in ([one] if one.finished() else below) if run.finished()]
    if not runs:
        raise RunError(f"Expected a finished run in {path}, found none; give a run's own folder.")
    first = runs[0].configuration()
    for run in runs[1:]:
        config = run.configuration()
        for group in sorted({*TASK, "constraints", "perturb"}):
            if (first.get(group) or {}) != (config.get(group) or {}):
                raise RunError(
                    f"Expected runs with the same {group}, found different ones in"
                    f" {runs[0].path.name} and {run.path.name}; give a run's own folder."
                )
    return runs, [run.path.name for run in below if run.about() and not run.finished()]


def best_trees(runs: Sequence[RunFolder], make: Make, tier: str, worlds: int) -> DataFrame:
    """The winner first, then the others by mean in validation worlds, and trees of the library.

    Args:
        runs: finished ones.
        make: creates an evaluator.
        tier: only trees of a single run that reached it in training; "": any.
        worlds: number of test worlds.

    Returns:
        A row per tree: `name`, the columns of `champions.summarised`, `evolved` (False: a tree of
        the library), `low` and `high` (95 % interval of the points), and `difference`,
        `difference_low` and `difference_high` (to the first row, of the pairs).

    Raises:
        ConfigError: there is no such tier.
        RunError: there are no such trees.
    """
    config = runs[0].configuration()
    classes, seed = Classes.model_validate(config["classes"]), int(config["seed"])
    if tier and tier not in classes.tiers:
        raise ConfigError(f"--tier: expected one of {', '.join(classes.tiers)}, found {tier!r}")
    constraints = recorded_constraints(config)
    contenders = _candidates(runs, classes, tier, constraints)
    used_worlds = frozenset(world for run in runs for world in _used_worlds(run))
    stage = max(record["snapshot"]["stage"] for run in runs for record in run.records())
    episodes = EFFORT * worlds
    race = validation_seeds(seed, used_worlds, episodes)
    test = validation_seeds(seed, used_worlds.union(race), worlds, Stream.TEST)
    problem = Problem.recorded(config)
    with closing(make(problem)) as evaluator:
        finalists = validate(
            contenders, race, evaluator, stage, classes, episodes=episodes, constraints=constraints
        )
    names = _names(runs, [candidate for candidate, _ in finalists[:3]])
    library = library_trees(config, for_targets=False)
    labels = library | names
    order = [*names, *(tree for tree in library if tree not in names)]
    problems = problem, perturbed_problem(config)
    found = in_worlds(order, make, problems, stage, test, classes, constraints)
    points = found.pivot(index="world", columns="tree", values="points")
    counters = [name for name in found if name.startswith("counters.")]
    rows = summarised(found.drop(columns=counters)).reset_index()
    rows["name"] = rows["tree"].map(labels)
    rows["evolved"] = rows["tree"].isin([*names])
    for columns, values in (
        (("points", "low", "high"), points),
        (("difference", "difference_low", "difference_high"), points.sub(points[order[0]], axis=0)),
    ):
        ends = [mean_interval(values[tree].tolist()) for tree in order]
        rows[[*columns]] = ends
    return rows


def shortened_trees(runs: Sequence[RunFolder]) -> list[dict[str, Any]]:
    """A run's shortened trees by size.

    Raises RunError if there are none, or several runs.
    """
    if len(runs) > 1:
        raise RunError(f"Expected one run for --front, found {len(runs)}; give a run's own folder.")
    trees: list[dict[str, Any]] = runs[0].summary()["champion"]["front"]
    if not trees:
        raise RunError(
            f"Expected a front in {runs[0].path}, found none: its tree was not shortened."
        )
    by_size = {tree["nodes"]: tree for tree in reversed(trees)}  # of equal sizes the shortened one
    return [by_size[size] for size in sorted(by_size)]


def _names(runs: Sequence[RunFolder], best: Sequence[Candidate]) -> dict[str, str]:
    """The names of the run's or sweep's trees, by text."""
    names: dict[str, str] = {}
    for candidate in best:
        names.setdefault(candidate.tree, candidate.id)
    if len(runs) == 1:
        champion = runs[0].summary()["champion"]
        name = names.get(champion["tree"], champion["record"]["id"])
        names[champion["tree"]] = f"{name}, the run's best robot"
    return names


def _candidates(
    runs: Sequence[RunFolder], classes: Classes, tier: str, constraints: Constraints
) -> list[Candidate]:
    """All trees of a run's last stage, or the best robot of each run of a sweep."""
    if len(runs) == 1:
        trees = by_fitness(
            runs[0].records(),
            classes,
            most=sys.maxsize,
            top=sys.maxsize,
            tier=tier,
            constraints=constraints,
        )
        if not trees:
            raise RunError(
                f"Expected {tier} robots in the last stage of {runs[0].path}, found none."
            )
        return trees
    if tier:
        raise ConfigError("--tier: expected a run's own folder with it, found a sweep's")
    best: dict[str, Candidate] = {}
    for run in runs:
        champion = run.summary()["champion"]
        record = champion["record"]
        name = f"{run.path.name}, {record['id']}"
        new = Candidate(champion["generation"], name, champion["tree"], record["fitness"])
        best.setdefault(new.tree, new)
    return list(best.values())


def _used_worlds(run: RunFolder) -> Iterator[int]:
    """The worlds of a run's training, choice and test."""
    for record in run.records():
        yield from record["worlds"]
    champion = run.summary()["champion"]
    yield from champion["chosen_in"]
    yield from (champion["validation"] or {}).get("worlds", ())
