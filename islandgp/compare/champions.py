"""Best robots and trees of the library in unseen worlds, under the task of every arm.

A run chooses its best robot in its own worlds, under its own rewards. Here the best robots of all
runs are evaluated in the same seeds of worlds that no run used, in the last stage, once under each
task: the world, rewards, curriculum and classes of some arms. Trees of the library are evaluated
too: a supervisor may inject trees that are good without evolution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from islandgp.bt.core.language import to_text
from islandgp.compare.arms import Run
from islandgp.compare.comparable import Comparison
from islandgp.compare.measures import POINTS, Measure
from islandgp.errors import ConfigError, RunError, StudyError, TreeError, UntrustedError, brief
from islandgp.evaluation.base import Evaluator, Problem, evaluated
from islandgp.evolution.validation import validation_seeds
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import NO_CONSTRAINTS, Constraints, violation
from islandgp.seeding import Stream
from islandgp.supervision.library import LibrarySettings, library_folder, read_library

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

Make = Callable[[Problem], Evaluator]

PERTURBED = "perturbed"
"""Column of points in perturbed worlds."""


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


def in_worlds(
    trees: Sequence[str],
    make: Make,
    problems: tuple[Problem, Problem | None],
    stage: int,
    worlds: Sequence[int],
    classes: Classes,
    constraints: Constraints = NO_CONSTRAINTS,
) -> DataFrame:
    """The episodes of trees in some worlds.

    Args:
        trees: distinct texts.
        make: creates an evaluator.
        problems: the second one has perturbed worlds; None: without them.
        stage: index of the curriculum's stage.
        worlds: seeds.
        classes: define the tiers.
        constraints: of the counters.

    Returns:
        A row per tree and world: `tree`, `world`, `points`, `perturbed` (points in the perturbed
        world), `feasible`, `reached.TIER` and `counters.NAME`.

    Raises:
        EvaluationError: an episode cannot be run.
    """
    from pandas import DataFrame

    rows: list[dict[str, Any]] = []
    places = [(tree, world) for tree in trees for world in worlds]
    with closing(make(problems[0])) as evaluator:
        outcomes = [o for each in evaluated(evaluator, trees, stage, worlds) for o in each]
    for (tree, world), outcome in zip(places, outcomes, strict=True):
        found = tiers(outcome, classes)
        rows.append(
            {
                "tree": tree,
                "world": world,
                "points": outcome.fitness,
                **(
                    {"feasible": not violation(outcome.counters, constraints)}
                    if constraints
                    else {}
                ),
                **{f"reached.{tier}": tier in found for tier in classes.milestones},
                **{f"counters.{name}": value for name, value in outcome.counters.items()},
            }
        )
    frame = DataFrame(rows)
    if problems[1] is not None:
        with closing(make(problems[1])) as evaluator:
            after = [o for each in evaluated(evaluator, trees, stage, worlds) for o in each]
        frame[PERTURBED] = [outcome.fitness for outcome in after]
    return frame


def summarised(episodes: DataFrame) -> DataFrame:
    """The means over the worlds by tree, and the lowest points as `worst`, `perturbed_worst`."""
    by_tree = episodes.drop(columns="world").groupby("tree", sort=False)
    means = by_tree.mean().assign(worst=by_tree["points"].min())
    if PERTURBED in episodes:
        means[f"{PERTURBED}_worst"] = by_tree[PERTURBED].min()
    return means


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
        StudyError: the domain's class cannot be imported.
    """
    from pandas import DataFrame, concat

    seeds = unseen_worlds(study, worlds)
    robots = study.runs.reset_index()[["arm", "run", "seed", "tree"]]
    others = DataFrame({"arm": [*trees.values()], "tree": [*trees]})
    everyone = concat([robots, others], ignore_index=True)
    texts = [*everyone["tree"].unique()]
    results = []
    for task in study.tasks:
        problems = problem_of(task.run), perturbed_problem(task.run.config)
        stage = len(problems[0].curriculum.stages) - 1
        found = in_worlds(texts, make, problems, stage, seeds, task.run.classes)
        rows = everyone.join(summarised(found), on="tree")
        results.append(rows.assign(task=task.label, own=rows["arm"].isin(task.arms)))
    return concat(results, ignore_index=True)


def problem_of(run: Run) -> Problem:
    """The problem of a run.

    Raises:
        StudyError: its domain cannot be imported.
        UntrustedError: only the run names its domain.
    """
    try:
        return Problem.recorded(run.config)
    except UntrustedError:
        raise
    except RunError as error:
        raise StudyError(
            f"Expected to find the domain {run.flat['domain.factory']} here, found"
            f" {brief(error)}; install it, or leave the unseen worlds out with"
            " --worlds 0."
        ) from error


def perturbed_problem(config: Mapping[str, Any]) -> Problem | None:
    """The problem of a run's perturbed worlds; None if its configuration has none."""
    return None if config.get("perturb") is None else Problem.recorded(config, perturbed=True)


def champion_keys(study: Comparison) -> tuple[str, ...]:
    """The keys of `champion_measures`."""
    if len(study.tasks) == 1:
        return ("unseen",)
    tasks = (f"unseen_{k}" for k in range(1, len(study.tasks) + 1))
    return (*tasks, *(c for c in study.generations if c.startswith("counters.")))


def with_champions(study: Comparison, tested: DataFrame) -> tuple[DataFrame, tuple[Measure, ...]]:
    """The frame of runs with measures of the best robots, and these measures.

    They are points under each task; with several tasks, also counters, which are the mean of a
    run's best robot in the worlds of its own task.
    """
    robots, several = tested[tested["run"].notna()], len(study.tasks) > 1
    runs, measures = study.runs, []
    for k, task in enumerate(study.tasks, 1):
        key = f"unseen_{k}" if several else "unseen"
        label = f"Best robot in unseen worlds{f' under {task.label}' if several else ''}"
        measures.append(Measure(key, label, POINTS))
        points = robots[robots["task"] == task.label].set_index("run")["points"]
        runs = runs.assign(**{key: points})
    own = robots[robots["own"]].set_index("run")
    for name in [c for c in own if c.startswith("counters.")] if several else ():
        label = f"{name.removeprefix('counters.')} of the best robot, own task"
        measures.append(Measure(name, label, "count"))
        runs = runs.assign(**{name: own[name]})
    return runs, tuple(measures)
