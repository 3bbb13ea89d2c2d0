"""`islandgp best`: the best trees of a finished run or sweep, in worlds that chose nothing."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any, Final

import click

from islandgp.commands.files import OUTPUT, STDIN, write_text
from islandgp.commands.trust_options import with_trust_options
from islandgp.errors import ConfigError, RunError
from islandgp.evaluation.base import Job

if TYPE_CHECKING:
    from islandgp.commands.tables import Column
    from islandgp.evaluation.base import Evaluator
    from islandgp.evolution.validation import Candidate
    from islandgp.records.folder import RunFolder
    from islandgp.scoring.classes import Classes
    from islandgp.scoring.constraints import Constraints

TIMEOUT: Final = 600.0  # s that an episode may take
EFFORT: Final = 20
"""Episodes of the race for each of --worlds."""


@dataclass(frozen=True, slots=True)
class Row:
    """A tree in the test worlds."""

    name: str  # what it is
    mean: float  # points, mean over the worlds
    low: float  # 95 % interval of the mean
    high: float
    reached: dict[str, float]  # by milestone: share of the worlds
    difference: float  # points, mean of the paired differences to the first row
    difference_low: float  # its 95 % interval
    difference_high: float
    evolved: bool  # it is a run's, not the library's
    tree: str
    feasible: float | None = None  # share of the worlds in which it keeps all constraints
    perturbed: float | None = None  # points, mean over the worlds after their perturbation
    perturbed_worst: float | None = None  # points, the least of these


@dataclass(frozen=True, slots=True)
class UnseenWorlds:
    """Test worlds for the final evaluation of trees."""

    stage: int  # of the curriculum, from 0
    worlds: tuple[int, ...]  # world seeds


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--tier", default="", help="Only trees that reached this tier in training.")
@click.option(
    "--worlds",
    type=click.IntRange(2, 10_000),
    default=100,
    show_default=True,
    help="Number of test worlds in which the best trees are evaluated.",
)
@click.option(
    "--workers", type=click.IntRange(0, 1024), default=0, help="Processes; 0: one per core."
)
@click.option("-o", "--output", type=OUTPUT, help="Write the winner to this file.")
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
@with_trust_options
def command(
    run: Path, tier: str, worlds: int, workers: int, output: str | None, as_json: bool
) -> None:
    """Find the best tree of the finished run, or the finished runs of a sweep, in the folder RUN.

    Candidates are all trees of the last stage, or the best robots of a sweep's runs. Successive
    halving in validation worlds selects three of them. These, the run's best robot and the
    library's reference trees are then evaluated in test worlds, which were used neither for
    training nor for selection.
    """
    from islandgp.evaluation.base import Problem
    from islandgp.evaluation.perturbation import recorded_perturbation
    from islandgp.evaluation.processes import Processes, cores

    runs = _finished(run)
    problem = Problem.recorded(runs[0].configuration())
    with closing(Processes(problem, workers or cores(), episode_timeout=TIMEOUT)) as evaluator:
        rows, test = _rows(runs, evaluator, tier, worlds)
    if recorded_perturbation(runs[0].configuration()) is not None:
        problem = Problem.recorded(runs[0].configuration(), perturbed=True)
        with closing(Processes(problem, workers or cores(), episode_timeout=TIMEOUT)) as evaluator:
            rows = _robust(rows, evaluator, test)
    if output is not None:
        write_text(output, rows[0].tree)
    if as_json:
        click.echo(json.dumps([_plain(row) for row in rows], indent=2))
    elif output != STDIN:
        _print(rows, worlds)


def _plain(row: Row) -> dict[str, Any]:
    """As JSON has it, without what only runs with constraints or perturbed worlds have."""
    return {name: value for name, value in asdict(row).items() if value is not None}


def _finished(path: Path) -> list[RunFolder]:
    """The run in a folder, or those of the sweep. Raises RunError where there is none."""
    from islandgp.records.folder import RunFolder

    one = RunFolder(path)
    below = [RunFolder(child) for child in sorted(path.iterdir())] if path.is_dir() else []
    runs = [run for run in ([one] if one.finished() else below) if run.finished()]
    if not runs:
        raise RunError(f"Expected a finished run in {path}, found none; give a run's own folder.")
    if unfinished := [run.path.name for run in below if run.about() and not run.finished()]:
        click.echo(
            f"islandgp: left out, as they are not finished: {', '.join(unfinished)}", err=True
        )
    for run in runs:
        _must_be_alike(runs[0], run)
    return runs


def _must_be_alike(first: RunFolder, other: RunFolder) -> None:
    """Raises RunError where points are not worth the same in two runs."""
    from islandgp.study.comparable import TASK

    a, b = first.configuration(), other.configuration()
    groups = sorted({*TASK, "constraints", "perturb"})
    if differ := [group for group in groups if (a.get(group) or {}) != (b.get(group) or {})]:
        raise RunError(
            f"Expected runs with one {differ[0]}, found that {first.path.name} and"
            f" {other.path.name} differ in it; give a run's own folder."
        )


def _rows(
    runs: Sequence[RunFolder], evaluator: Evaluator, tier: str, worlds: int
) -> tuple[list[Row], UnseenWorlds]:
    """The race's winner first, the others by falling mean in validation worlds; and the test."""
    from islandgp.evolution.validation import validate, validation_seeds
    from islandgp.intervals import interval
    from islandgp.scoring.classes import Classes, tiers
    from islandgp.scoring.constraints import feasible_share, recorded_constraints
    from islandgp.seeding import Stream
    from islandgp.study.library import reference_trees

    config = runs[0].configuration()
    classes, seed = Classes.model_validate(config["classes"]), int(config["seed"])
    if tier and tier not in classes.tiers:
        raise ConfigError(f"--tier: expected one of {', '.join(classes.tiers)}, found {tier!r}")
    constraints = recorded_constraints(config)
    if len(runs) == 1:
        contenders = _robots(runs[0], classes, tier, constraints)
    else:
        contenders = _best_robots(runs, tier)
    used = frozenset(world for run in runs for world in _used(run))
    stage = max(record["snapshot"]["stage"] for run in runs for record in run.records())
    race = validation_seeds(seed, used, EFFORT * worlds)
    finalists = validate(
        contenders,
        race,
        evaluator,
        stage,
        classes,
        episodes=EFFORT * worlds,
        constraints=constraints,
    )
    test = validation_seeds(seed, used.union(race), worlds, Stream.TEST)
    trees: dict[str, tuple[str, bool]] = {}
    for candidate, _ in finalists[:3]:
        trees.setdefault(candidate.tree, (candidate.id, True))
    if len(runs) == 1:
        champion = runs[0].summary()["champion"]["record"]
        name, _ = trees.get(champion["tree"], (champion["id"], True))
        trees[champion["tree"]] = (f"{name}, the run's best robot", True)
    for name, text in reference_trees(config).items():
        trees.setdefault(text, (f"library: {name}", False))
    outcomes = evaluator.evaluate([Job(tree, stage, world) for tree in trees for world in test])
    rows = []
    for k, (tree, (name, evolved)) in enumerate(trees.items()):
        episodes = outcomes[k * worlds : (k + 1) * worlds]
        reached = [tiers(outcome, classes) for outcome in episodes]
        row = Row(
            name,
            *interval([outcome.fitness for outcome in episodes]),
            {m: fmean(m in r for r in reached) for m in classes.milestones},
            *interval(
                [a.fitness - b.fitness for a, b in zip(episodes, outcomes[:worlds], strict=True)]
            ),
            evolved,
            tree,
            feasible_share([o.counters for o in episodes], constraints) if constraints else None,
        )
        rows.append(row)
    return rows, UnseenWorlds(stage, test)


def _robust(rows: Sequence[Row], evaluator: Evaluator, test: UnseenWorlds) -> list[Row]:
    """The rows with what the trees earn in the test worlds after their perturbation."""
    from islandgp.evaluation.base import evaluated

    outcomes = evaluated(evaluator, [row.tree for row in rows], test.stage, test.worlds)
    points = [[outcome.fitness for outcome in own] for own in outcomes]
    return [
        replace(row, perturbed=fmean(own), perturbed_worst=min(own))
        for row, own in zip(rows, points, strict=True)
    ]


def _robots(
    run: RunFolder, classes: Classes, tier: str, constraints: Constraints
) -> list[Candidate]:
    """All trees of a run's last stage."""
    from islandgp.evolution.validation import candidates

    records = list(run.records())
    everyone = sum(len(record["individuals"]) for record in records)
    trees = candidates(
        records, classes, most=everyone, top=everyone, tier=tier, constraints=constraints
    )
    if not trees:
        raise RunError(f"Expected {tier} robots in the last stage of {run.path}, found none.")
    return trees


def _best_robots(runs: Sequence[RunFolder], tier: str) -> list[Candidate]:
    """The best robot of each run."""
    from islandgp.evolution.validation import Candidate

    if tier:
        raise ConfigError("--tier: expected a run's own folder with it, found a sweep's")
    best: dict[str, Candidate] = {}
    for run in runs:
        champion = run.summary()["champion"]
        record = champion["record"]
        name = f"{run.path.name}, {record['id']}"
        new = Candidate(champion["generation"], name, record["tree"], record["fitness"])
        best.setdefault(record["tree"], new)
    return list(best.values())


def _used(run: RunFolder) -> Iterator[int]:
    """The worlds that trained a run's trees or chose among them."""
    for record in run.checked_records():
        yield from record["worlds"]
    if (validation := run.summary()["champion"]["validation"]) is not None:
        yield from validation["worlds"]


def _print(rows: Sequence[Row], worlds: int) -> None:
    from islandgp.commands.tables import Column, print_table, standard_output
    from islandgp.text import title

    others = [
        f"{row.difference:+,.0f} [{row.difference_low:+,.0f}, {row.difference_high:+,.0f}]"
        for row in rows[1:]
    ]
    console = standard_output()
    print_table(
        console,
        [
            Column("tree", tuple(row.name for row in rows), right=False),
            Column("points", tuple(f"{row.mean:,.0f}" for row in rows)),
            Column("95 % interval", tuple(f"[{row.low:,.0f}, {row.high:,.0f}]" for row in rows)),
            *(
                Column(title(tier), tuple(f"{row.reached[tier]:.0%}" for row in rows))
                for tier in rows[0].reached
            ),
            *(
                [Column("constraints kept", tuple(f"{row.feasible:.0%}" for row in rows))]
                if rows[0].feasible is not None
                else []
            ),
            *_robust_columns(rows),
            Column("to the first", ("", *others)),
        ],
    )
    if rows[0].perturbed is not None:
        console.print("\nPerturbed: mean and worst in the same worlds after their perturbation.")
    console.print(
        f"\nMeans over {worlds} test worlds of the last stage;"
        " training and selection used other worlds."
    )


def _robust_columns(rows: Sequence[Row]) -> Iterator[Column]:
    """Mean and worst of the perturbed worlds, if the runs have such."""
    from islandgp.commands.tables import Column

    for heading, name in (("perturbed", "perturbed"), ("worst", "perturbed_worst")):
        points = [getattr(row, name) for row in rows]
        if None not in points:
            yield Column(heading, tuple(f"{value:,.0f}" for value in points))
