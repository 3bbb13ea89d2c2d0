"""Best robots and trees of the library in unseen worlds, under the task of every arm.

A run chooses its best robot in its own worlds, under its own rewards. Here the best robots of all
runs are evaluated in the same seeds of worlds that no run used, in the last stage, once under each
task: the world, rewards, curriculum and classes of some arms. Trees of the library are evaluated
too: a supervisor may inject trees that are good without evolution.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from contextlib import closing, suppress
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from islandgp.bt.core.language import to_text
from islandgp.compare.arms import Arm, Run, find
from islandgp.compare.comparable import Comparison
from islandgp.compare.measures import POINTS, Measure, read_runs
from islandgp.domain import Outcome
from islandgp.errors import ConfigError, RunError, TreeError, brief
from islandgp.evaluation.base import Evaluator, Problem, evaluated
from islandgp.evolution.validation import validation_seeds
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import TASK
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import Constraints, recorded_constraints, violation
from islandgp.seeding import Stream
from islandgp.statistics import mean_interval
from islandgp.supervision.library import LibrarySettings, library_folder, read_library

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

Make = Callable[[Problem], Evaluator]

PERTURBED = "perturbed"  # column of points in perturbed worlds


def unseen_worlds(study: Comparison, n: int) -> tuple[int, ...]:
    """The first n world seeds of a separate stream that no run of the study used.

    They differ from those of `islandgp play`, which are 0, 1, 2, ...
    """
    used = frozenset[int]().union(*study.runs["worlds"])
    return validation_seeds(0, used, n, Stream.UNSEEN)


def library_trees(config: Mapping[str, Any], *, for_targets: bool = True) -> dict[str, str]:
    """The names of a run's reference trees by their canonical text, and then those for targets.

    Names contain a colon, unlike those of arms. {} if the run had no folder of trees, or if the
    folder, one of these trees or the domain is not here.

    Raises:
        RunError: the run's settings are not of this version.
    """
    try:
        settings = LibrarySettings.model_validate(config["library"])
    except ValidationError as error:
        raise RunError(
            f"Expected settings of this version in a run's configuration, found {brief(error)};"
            " look at the run with the version that its about.json names, or repeat its command."
        ) from None
    names = [*settings.reference_trees]
    names += [name for each in settings.trees.values() for name in each] if for_targets else []
    if settings.folder is None:
        return {}
    with suppress(RunError, ConfigError, TreeError):
        domain = Problem.recorded(config).domain
        folder, classes = library_folder(settings.folder, domain), Classes(**config["classes"])
        library = read_library(settings, folder, domain.schema.vocabulary, classes)
        texts = {to_text(library.trees[name]): f"library: {name}" for name in reversed(names)}
        return dict(reversed(texts.items()))
    return {}


def in_worlds(trees: Sequence[str], make: Make, run: Run, worlds: Sequence[int]) -> DataFrame:
    """The episodes of trees in some worlds, under a run's task in its last stage.

    Args:
        trees: distinct texts.
        make: creates an evaluator.
        run: with the task.
        worlds: seeds.

    Returns:
        As `episode_frame`, with `perturbed` (points in the perturbed world) if the run has one.

    Raises:
        EvaluationError: an episode cannot be run.
        RunError: the run's domain cannot be imported.
        UntrustedError: only the run names its domain.
    """

    def outcomes(problem: Problem) -> list[list[Outcome]]:
        with closing(make(problem)) as evaluator:
            return evaluated(evaluator, trees, len(problem.curriculum.stages) - 1, worlds)

    plain = outcomes(Problem.recorded(run.config))
    frame = episode_frame(trees, plain, run.classes, recorded_constraints(run.config))
    if run.config.get("perturb") is not None:
        perturbed = outcomes(Problem.recorded(run.config, perturbed=True))
        frame[PERTURBED] = [o.fitness for own in perturbed for o in own]
    return frame


def episode_frame(
    trees: Sequence[Hashable],
    outcomes: Sequence[Sequence[Outcome]],
    classes: Classes,
    constraints: Constraints,
) -> DataFrame:
    """A row per tree and world: `tree`, `world` (from 0), `points`, `feasible` and what it reached.

    The last are `reached.TIER` and `counters.NAME`. `outcomes`: of each tree, in the same worlds.
    """
    from pandas import DataFrame

    return DataFrame(
        {
            "tree": tree,
            "world": world,
            "points": outcome.fitness,
            **({"feasible": not violation(outcome.counters, constraints)} if constraints else {}),
            **{f"reached.{tier}": tier in tiers(outcome, classes) for tier in classes.tiers},
            **{f"counters.{name}": value for name, value in outcome.counters.items()},
        }
        for tree, own in zip(trees, outcomes, strict=True)
        for world, outcome in enumerate(own)
    )


def summarised(episodes: DataFrame) -> DataFrame:
    """The means over the worlds by tree, and the lowest points as `worst`, `perturbed_worst`."""
    by_tree = episodes.drop(columns="world").groupby("tree", sort=False)
    means = by_tree.mean().assign(worst=by_tree["points"].min())
    if PERTURBED in episodes:
        means[f"{PERTURBED}_worst"] = by_tree[PERTURBED].min()
    return means


def compared(episodes: DataFrame) -> DataFrame:
    """`summarised`, with 95 % intervals and the paired differences to the first tree.

    Columns: `points`, `difference`, both with `_low` and `_high`, which are nan for a single world,
    and `better_in`, the number of worlds in which the tree earns more than the first one.
    """
    rows = summarised(episodes)
    points = episodes.pivot(index="world", columns="tree", values="points")
    apart = points.sub(points[rows.index[0]], axis=0)
    for name, values in (("points", points), ("difference", apart)):
        ends = [mean_interval(values[tree].tolist()) for tree in rows.index]
        rows[[name, f"{name}_low", f"{name}_high"]] = ends
    return rows.assign(better_in=apart.gt(0).sum())


def evaluate_champions(
    study: Comparison, make: Make, *, worlds: int, trees: Mapping[str, str]
) -> DataFrame:
    """Evaluates each run's best robot, and further trees, in the same unseen worlds.

    Args:
        study: the comparison.
        make: creates an evaluator.
        worlds: number of world seeds.
        trees: names of further trees by text.

    Returns:
        A row per tree and task, as `summarised`, with `arm` (or the tree's name), `run` and `seed`
        (missing for further trees), `task` (label) and `own` (whether it is that of its arm).

    Raises:
        EvaluationError: an episode cannot be run.
        RunError: a domain's class cannot be imported.
    """
    from pandas import DataFrame, concat

    seeds = unseen_worlds(study, worlds)
    robots = study.runs.reset_index()[["arm", "run", "seed", "tree"]]
    others = DataFrame({"arm": [*trees.values()], "tree": [*trees]})
    everyone = concat([robots, others], ignore_index=True)
    texts = [*everyone["tree"].unique()]
    results = []
    for task in study.tasks:
        found = in_worlds(texts, make, task.run, seeds)
        rows = everyone.join(summarised(found), on="tree")
        results.append(rows.assign(task=task.label, own=rows["arm"].isin(task.arms)))
    return concat(results, ignore_index=True)


def champion_measures(study: Comparison) -> tuple[Measure, ...]:
    """The measures of the best robots in unseen worlds: their points under each task.

    With several tasks, also the counters, which are means in the worlds of a run's own task.
    """
    if len(study.tasks) == 1:
        return (Measure("unseen", "Best robot in unseen worlds", POINTS),)
    counters = [name for name in study.generations if name.startswith("counters.")]
    return (
        *(
            Measure(f"unseen_{k}", f"Best robot in unseen worlds under {task.label}", POINTS)
            for k, task in enumerate(study.tasks, 1)
        ),
        *(
            Measure(name, f"{name.removeprefix('counters.')} of the best robot, own task", "count")
            for name in counters
        ),
    )


def with_champions(study: Comparison, tested: DataFrame) -> DataFrame:
    """The frame of runs with the values of `champion_measures`."""
    robots = tested[tested["run"].notna()]
    points = robots.pivot(index="run", columns="task", values="points")
    own, n = robots[robots["own"]].set_index("run"), len(study.tasks)
    keys = [measure.key for measure in champion_measures(study)]
    values = {k: points[task.label] for k, task in zip(keys[:n], study.tasks, strict=True)}
    return study.runs.assign(**values, **{key: own[key] for key in keys[n:]})


MOST: Final = 20
"""Most best robots that are evaluated together: those with the highest means in validation."""


def runs_of_one_task(folder: Path) -> list[Run]:
    """The runs in a folder and below it, also unfinished ones.

    Raises:
        StudyError: there is no such folder.
        RunError: no run is finished, or the fitness of two of them is not comparable.
    """
    runs = find([folder])
    finished = [run for run in runs if run.finished]
    if not finished:
        raise RunError(f"Expected a finished run in {folder}, found none; give a run's own folder.")
    first = finished[0]
    for run, group in product(finished, sorted({*TASK, "constraints", "perturb"})):
        if (first.config.get(group) or {}) != (run.config.get(group) or {}):
            raise RunError(
                f"Expected runs with the same {group}, found different ones in"
                f" {first.path.name} and {run.path.name}; give a run's own folder."
            )
    return runs


def best_trees(runs: Sequence[Run], make: Make, worlds: int) -> DataFrame:
    """The best robots of runs, by their means in validation, in worlds that none of them used.

    Args:
        runs: finished ones of one task.
        make: creates an evaluator.
        worlds: number of test worlds.

    Returns:
        The rows of `compared`, with `tree`, `name` and `evolved` (False: a tree of the library's
        reference trees, which come last).
    """
    first = runs[0]
    robots = read_runs([Arm("", "", tuple(runs))])[1]
    robots["violation"] = robots.get("constraints.violation", 0.0)
    order = ["violation", "validation_mean", "champion_fitness"]
    chosen = robots.sort_values(order, ascending=[True, False, False]).drop_duplicates("tree")
    names = {tree: Path(run).name for run, tree in chosen["tree"].head(MOST).items()}
    library = library_trees(first.config, for_targets=False)
    labels = names | {tree: label for tree, label in library.items() if tree not in names}
    used = frozenset[int]().union(*robots["worlds"])
    test = validation_seeds(first.seed, used, worlds, Stream.TEST)
    episodes = in_worlds([*labels], make, first, test)
    return (
        compared(episodes)
        .reset_index()
        .assign(name=[*labels.values()], evolved=[tree in names for tree in labels])
    )


def shortened_trees(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """A run's shortened trees by size.

    Raises RunError if there are none, or several runs.
    """
    if len(runs) > 1:
        raise RunError(f"Expected one run for --front, found {len(runs)}; give a run's own folder.")
    trees: list[dict[str, Any]] = RunFolder(runs[0].path).summary()["champion"]["front"]
    if not trees:
        raise RunError(
            f"Expected a front in {runs[0].path}, found none: its tree was not shortened."
        )
    return trees
