"""Best robots and trees of the library in unseen worlds, under the task of every arm.

A run chooses its best robot in its own worlds, under its own rewards. Here the best robots of all
runs are evaluated in the same seeds of worlds that no run used, in the last stage, once under each
task: the world, rewards, curriculum and classes of some arms. Trees of the library are evaluated
too: a supervisor may inject trees that are good without evolution.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from islandgp.bt.core.language import to_text
from islandgp.compare.arms import Run
from islandgp.compare.comparable import Comparison
from islandgp.compare.measures import POINTS, Measure
from islandgp.domain import Outcome
from islandgp.errors import ConfigError, RunError, StudyError, TreeError, UntrustedError, brief
from islandgp.evaluation.base import Evaluator, Problem, evaluated
from islandgp.evolution.candidates import Candidate, by_fitness
from islandgp.evolution.validation import validate, validation_seeds
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import TASK
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import (
    NO_CONSTRAINTS,
    Constraints,
    recorded_constraints,
    violation,
)
from islandgp.seeding import Stream
from islandgp.statistics import mean_interval
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
        As `episode_frame`, with `perturbed` (points in the perturbed world).

    Raises:
        EvaluationError: an episode cannot be run.
    """

    def outcomes(problem: Problem) -> list[list[Outcome]]:
        with closing(make(problem)) as evaluator:
            return evaluated(evaluator, trees, stage, worlds)

    frame = episode_frame(trees, outcomes(problems[0]), classes, constraints)
    if problems[1] is not None:
        frame[PERTURBED] = [o.fitness for own in outcomes(problems[1]) for o in own]
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


def best_trees(runs: Sequence[RunFolder], make: Make, worlds: int) -> DataFrame:
    """The winner first, then the others by mean in validation worlds, and trees of the library.

    Args:
        runs: finished ones.
        make: creates an evaluator.
        worlds: number of test worlds.

    Returns:
        The rows of `compared`, with `tree`, `name` and `evolved` (False: a tree of the library).
    """
    config = runs[0].configuration()
    classes, seed = Classes.model_validate(config["classes"]), int(config["seed"])
    constraints = recorded_constraints(config)
    contenders = _candidates(runs, classes, constraints)
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
    labels = library_trees(config, for_targets=False) | names
    order = dict.fromkeys([*names, *labels])
    problems = problem, perturbed_problem(config)
    rows = compared(in_worlds([*order], make, problems, stage, test, classes, constraints))
    return rows.reset_index().assign(
        name=[labels[tree] for tree in order], evolved=[tree in names for tree in order]
    )


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
    return trees


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
    runs: Sequence[RunFolder], classes: Classes, constraints: Constraints
) -> list[Candidate]:
    """All trees of a run's last stage, or the best robot of each run of a sweep."""
    if len(runs) == 1:
        records, most = runs[0].records(), sys.maxsize
        return by_fitness(records, classes, most=most, top=most, constraints=constraints)
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
