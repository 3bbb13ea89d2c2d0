"""`islandgp best`: the best trees of a finished run or sweep, in unseen worlds."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import click

from islandgp.commands.files import OUTPUT, STDIN, write_text
from islandgp.commands.options import with_config_dir_option, with_workers_option
from islandgp.commands.tables import Column, print_table, standard_output
from islandgp.compare.library import reference_trees
from islandgp.errors import ConfigError, RunError
from islandgp.evaluation.base import Evaluator, Problem, evaluated
from islandgp.evaluation.perturbation import recorded_perturbation
from islandgp.evaluation.processes import Processes, cores
from islandgp.evolution.candidates import Candidate, CandidatesByFitness
from islandgp.evolution.validation import validate, validation_seeds
from islandgp.gate import cleaned
from islandgp.intervals import interval
from islandgp.records.folder import RunFolder
from islandgp.records.parameters import TASK
from islandgp.scoring.classes import Classes, tiers
from islandgp.scoring.constraints import Constraints, feasible_share, recorded_constraints
from islandgp.seeding import Stream
from islandgp.text import in_interval, in_points, title

TIMEOUT: Final = 600.0  # time limit of an episode, s
EFFORT: Final = 20
"""Episodes of successive halving for each of --worlds."""


@dataclass(frozen=True, slots=True)
class Row:
    """A tree in the test worlds."""

    name: str
    mean: float  # points, mean over the worlds
    low: float  # 95 % interval of the mean
    high: float
    reached: dict[str, float]  # by milestone: share of the worlds
    difference: float  # points, mean of the paired differences to the first row
    difference_low: float  # its 95 % interval
    difference_high: float
    evolved: bool  # False: a tree of the library
    tree: str
    feasible: float | None = None  # share of the worlds in which it keeps all constraints
    perturbed: float | None = None  # points, mean over the worlds after their perturbation
    perturbed_worst: float | None = None  # points, the lowest of these


@dataclass(frozen=True, slots=True)
class UnseenWorlds:
    """Test worlds for the final evaluation of trees."""

    stage: int  # of the curriculum, from 0
    worlds: tuple[int, ...]  # world seeds


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--tier", help="Only trees that reached this tier in training.")
@click.option(
    "--worlds",
    type=click.IntRange(2, 10_000),
    default=100,
    help="Number of test worlds in which the best trees are evaluated.",
)
@with_workers_option
@click.option("-o", "--output", type=OUTPUT, help="Write the winner to this file.")
@click.option(
    "--front", is_flag=True, help="Print the run's shortened trees, by size, and run no episode."
)
@click.option("--nodes", type=click.IntRange(1), help="Print the tree of --front of this size.")
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
@with_config_dir_option
def command(
    run: Path,
    tier: str | None,
    worlds: int,
    workers: int,
    output: str | None,
    front: bool,
    nodes: int | None,
    as_json: bool,
) -> None:
    """Find the best tree of the finished run, or the finished runs of a sweep, in the folder RUN.

    Candidates are all trees of the last stage, or the best robots of a sweep's runs. Successive
    halving in validation worlds selects three of them. These, the run's best robot and the
    library's reference trees are then evaluated in test worlds, which were used neither for
    training nor for selection.
    """
    if nodes is not None and not front:
        raise click.UsageError("expected --front with --nodes")
    if front and tier:
        raise click.UsageError("expected --tier without --front, which runs no episode")
    runs = _finished(run)
    if front:
        _show_front(runs, nodes, output, as_json)
        return
    config = runs[0].configuration()
    processes = partial(Processes, workers=workers or cores(), episode_timeout=TIMEOUT)
    with closing(processes(Problem.recorded(config))) as evaluator:
        rows, test = _rows(runs, evaluator, tier or "", worlds)
    if recorded_perturbation(config) is not None:
        with closing(processes(Problem.recorded(config, perturbed=True))) as evaluator:
            rows = _with_perturbed(rows, evaluator, test)
    if output is not None:
        write_text(output, rows[0].tree)
    if as_json:
        plain = [{k: v for k, v in asdict(row).items() if v is not None} for row in rows]
        click.echo(json.dumps(plain, indent=2))
    elif output != STDIN:
        _print(rows, worlds)


def _show_front(
    runs: Sequence[RunFolder], nodes: int | None, output: str | None, as_json: bool
) -> None:
    """Prints the front of size against points, or one of its trees.

    Raises:
        RunError: there is more than one run, no front, or no tree of that size.
    """
    if len(runs) > 1:
        raise RunError(f"Expected one run for --front, found {len(runs)}; give a run's own folder.")
    trees = runs[0].summary()["champion"]["front"]
    if not trees:
        raise RunError(
            f"Expected a front in {runs[0].path}, found none: its tree was not shortened."
        )
    by_size = {tree["nodes"]: tree for tree in reversed(trees)}  # of equal sizes the shortened one
    chosen = next(tree for tree in trees if tree["chosen"])
    if nodes is not None and nodes not in by_size:
        sizes = ", ".join(map(str, sorted(by_size)))
        raise RunError(f"--nodes: expected one of {sizes}, found {nodes}")
    tree = chosen if nodes is None else by_size[nodes]
    if output is not None:
        write_text(output, tree["tree"])
    if as_json:
        click.echo(json.dumps(trees, indent=2))
    elif nodes is not None and output is None:
        click.echo(tree["tree"], nl=False)
    elif output != STDIN:
        _print_front([by_size[size] for size in sorted(by_size)])


def _print_front(trees: Sequence[Mapping[str, Any]]) -> None:
    differences = [
        "" if (d := tree["difference"]) is None else in_interval(d["mean"], d["low"], d["high"])
        for tree in trees
    ]
    console = standard_output()
    columns = [
        Column("nodes", [str(tree["nodes"]) for tree in trees]),
        Column("to the longest (95 %)", differences),
        Column("", ["best robot" if tree["chosen"] else "" for tree in trees], left=True),
    ]
    print_table(console, columns)
    console.print(
        "\nPoints in the same worlds, in which no tree was made; --nodes N prints that tree."
    )


def _finished(path: Path) -> list[RunFolder]:
    """The run in a folder, or those of the sweep.

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
    if unfinished := [run.path.name for run in below if run.about() and not run.finished()]:
        click.echo(
            cleaned(f"islandgp: left out, as they are not finished: {', '.join(unfinished)}"),
            err=True,
        )
    first = runs[0].configuration()
    for run in runs[1:]:
        config = run.configuration()
        for group in sorted({*TASK, "constraints", "perturb"}):
            if (first.get(group) or {}) != (config.get(group) or {}):
                raise RunError(
                    f"Expected runs with the same {group}, found different ones in"
                    f" {runs[0].path.name} and {run.path.name}; give a run's own folder."
                )
    return runs


def _rows(
    runs: Sequence[RunFolder], evaluator: Evaluator, tier: str, worlds: int
) -> tuple[list[Row], UnseenWorlds]:
    """The rows, the winner first and then by mean in validation worlds; and the test worlds."""
    config = runs[0].configuration()
    classes, seed = Classes.model_validate(config["classes"]), int(config["seed"])
    if tier and tier not in classes.tiers:
        raise ConfigError(f"--tier: expected one of {', '.join(classes.tiers)}, found {tier!r}")
    constraints = recorded_constraints(config)
    contenders = _candidates(runs, classes, tier, constraints)
    used_worlds = frozenset(world for run in runs for world in _used_worlds(run))
    stage = max(record["snapshot"]["stage"] for run in runs for record in run.records())
    race = validation_seeds(seed, used_worlds, EFFORT * worlds)
    finalists = validate(
        contenders,
        race,
        evaluator,
        stage,
        classes,
        episodes=EFFORT * worlds,
        constraints=constraints,
    )
    test = validation_seeds(seed, used_worlds.union(race), worlds, Stream.TEST)
    names: dict[str, str] = {}  # of the run's or sweep's trees
    for candidate, _ in finalists[:3]:
        names.setdefault(candidate.tree, candidate.id)
    if len(runs) == 1:
        champion = runs[0].summary()["champion"]
        name = names.get(champion["tree"], champion["record"]["id"])
        names[champion["tree"]] = f"{name}, the run's best robot"
    library = {tree: f"library: {name}" for name, tree in reference_trees(config).items()}
    labels = {**names, **{tree: name for tree, name in library.items() if tree not in names}}
    outcomes = evaluated(evaluator, list(labels), stage, test)
    rows = []
    for (tree, label), episodes in zip(labels.items(), outcomes, strict=True):
        reached = [tiers(outcome, classes) for outcome in episodes]
        pairs = zip(episodes, outcomes[0], strict=True)
        row = Row(
            label,
            *interval([outcome.fitness for outcome in episodes]),
            {m: fmean(m in r for r in reached) for m in classes.milestones},
            *interval([own.fitness - first.fitness for own, first in pairs]),
            tree in names,
            tree,
            feasible_share([o.counters for o in episodes], constraints) if constraints else None,
        )
        rows.append(row)
    return rows, UnseenWorlds(stage, test)


def _with_perturbed(rows: Sequence[Row], evaluator: Evaluator, test: UnseenWorlds) -> list[Row]:
    """The rows with the trees' points in the perturbed test worlds."""
    outcomes = evaluated(evaluator, [row.tree for row in rows], test.stage, test.worlds)
    points = [[outcome.fitness for outcome in values] for values in outcomes]
    return [
        replace(row, perturbed=fmean(values), perturbed_worst=min(values))
        for row, values in zip(rows, points, strict=True)
    ]


def _candidates(
    runs: Sequence[RunFolder], classes: Classes, tier: str, constraints: Constraints
) -> list[Candidate]:
    """All trees of a run's last stage, or the best robot of each run of a sweep."""
    if len(runs) == 1:
        everyone = CandidatesByFitness(
            classes, most=sys.maxsize, top=sys.maxsize, tier=tier, constraints=constraints
        )
        if not (trees := everyone.best_of(runs[0].records())):
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
    if champion["validation"] is not None:
        yield from champion["validation"]["worlds"]


def _print(rows: Sequence[Row], worlds: int) -> None:
    def column(heading: str, form: Callable[[float], str], name: str) -> list[Column]:
        """A column of numbers, if the rows have them."""
        values: list[Any] = [getattr(row, name) for row in rows]
        return [] if None in values else [Column(heading, [*map(form, values)])]

    differences = [
        in_interval(row.difference, row.difference_low, row.difference_high) for row in rows[1:]
    ]
    console = standard_output()
    columns = [
        Column("tree", [cleaned(row.name) for row in rows], left=True),
        *column("points", in_points, "mean"),
        Column("95 % interval", [f"[{in_points(row.low)}, {in_points(row.high)}]" for row in rows]),
        *(
            Column(title(tier), [f"{row.reached[tier]:.0%}" for row in rows])
            for tier in rows[0].reached
        ),
        *column("constraints kept", "{:.0%}".format, "feasible"),
        *column("perturbed", in_points, "perturbed"),
        *column("worst", in_points, "perturbed_worst"),
        Column("to the first", ["", *differences]),
    ]
    print_table(console, columns)
    if rows[0].perturbed is not None:
        console.print("\nPerturbed: mean and worst in the same worlds after their perturbation.")
    console.print(
        f"\nMeans over {worlds} test worlds of the last stage;"
        " training and selection used other worlds."
    )
