"""`islandgp play`: a tree in many worlds of its domain, or in one to watch."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import asdict
from math import nan
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Final

import click

from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import Node
from islandgp.commands.files import FILE, called, read_tree
from islandgp.commands.rerun import with_rerun_option
from islandgp.commands.setting import (
    Chosen,
    NotNegative,
    stage_index,
    tree_in_domain,
    with_domain_options,
    with_stage_option,
    with_timeout_option,
)
from islandgp.commands.tables import (
    Column,
    fitting,
    numbers,
    print_table,
    standard_output,
    width_of,
)
from islandgp.errors import EvaluationError
from islandgp.plain import nan_to_none

if TYPE_CHECKING:
    from islandgp.config.settings import Settings
    from islandgp.domain import Outcome, Schema

Named = Iterable[tuple[str, Sequence[float]]]
"""Values by name, one in each world."""

MOST_SECONDS: Final = 1e6  # of an episode, as evaluators have it


@click.command()
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.option(
    "--seeds",
    type=click.IntRange(1, 100_000),
    default=30,
    show_default=True,
    help="Number of worlds.",
)
@click.option("--watch", is_flag=True, help="Follow one episode in the terminal.")
@click.option("--seed", type=click.IntRange(0), default=0, help="World of --watch; default: 0.")
@click.option(
    "--speed",
    type=NotNegative(),
    default=10.0,
    help="Speed of --watch, as a factor; 0: without waiting.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the outcomes as JSON.")
@with_rerun_option
@with_domain_options
@with_stage_option
@with_timeout_option
def command(
    files: tuple[str, ...],
    seeds: int,
    watch: bool,
    seed: int,
    speed: float,
    as_json: bool,
    chosen: Chosen,
    stage: int | None,
    timeout: float,
) -> None:
    """Run the tree in each of FILES in the worlds 0, 1, 2, ...

    For one tree, the output has the counters of each world, the components of the
    fitness, and the quality tiers (Table 4). Several trees are compared in the same
    worlds, by the paired differences to the first. Evolution uses other seeds. If the
    configuration perturbs worlds (--set 'perturb=...'), the fitness in the perturbed
    worlds is printed as well.
    """
    if watch and len(files) > 1:
        raise click.UsageError(f"expected one FILE for --watch, found {len(files)}")
    tree, settings, problem = tree_in_domain(files[0], chosen)
    settings = _limited(settings, timeout)
    index = stage_index(settings, stage)
    if watch:
        from islandgp.viewer.recording import record
        from islandgp.viewer.watch import watch as show

        recording = record(tree, problem, seed=seed, stage=index, limit=timeout)
        show(recording, speed=speed or 10.0, pause=time.sleep if speed else lambda _: None)
        return
    others = [read_tree(file, problem.domain.schema.vocabulary) for file in files[1:]]
    if others:
        _compare((tree, *others), [called(file) for file in files], settings, seeds, index, as_json)
        return
    outcomes = _outcomes(tree, settings, seeds, index)
    (perturbed,) = _robust((tree,), settings, seeds, index) or ((),)
    if not as_json:
        _print(outcomes, problem.domain.schema, settings, index, perturbed)
        return
    plain = [{"fitness": outcome.fitness, **asdict(outcome)} for outcome in outcomes]
    for row, points_there in zip(plain, perturbed, strict=False):
        row["perturbed"] = points_there
    click.echo(json.dumps(plain, indent=2))


def _compare(
    trees: Sequence[Node],
    names: Sequence[str],
    settings: Settings,
    seeds: int,
    stage: int,
    as_json: bool,
) -> None:
    """Prints the fitness of several trees in the same worlds."""
    points = [_points_in(tree, settings, seeds, stage) for tree in trees]
    robust = _robust(trees, settings, seeds, stage)
    if not as_json:
        _print_comparison(names, points, robust, settings)
        return
    rows = _comparison(points, robust)
    named = [{"file": name, **row} for name, row in zip(names, rows, strict=True)]
    click.echo(json.dumps(nan_to_none(named), indent=2))


def _points_in(
    tree: Node, settings: Settings, seeds: int, stage: int, *, perturbed: bool = False
) -> list[float]:
    """The fitness in each world."""
    return [o.fitness for o in _outcomes(tree, settings, seeds, stage, perturbed=perturbed)]


def _robust(trees: Sequence[Node], settings: Settings, seeds: int, stage: int) -> list[list[float]]:
    """The fitness of each tree in the perturbed worlds; [] where there are none."""
    if settings.perturb is None:
        return []
    return [_points_in(tree, settings, seeds, stage, perturbed=True) for tree in trees]


def _compared(own: Sequence[float], first: Sequence[float]) -> dict[str, float]:
    """Mean fitness and mean paired difference to the first tree, each with its 95 % interval.

    The ends of an interval are nan where there is one world.
    """
    from islandgp.intervals import interval

    pairs = [a - b for a, b in zip(own, first, strict=True)]
    names = ("fitness", "fitness_low", "fitness_high")
    others = ("difference", "difference_low", "difference_high")
    return dict(zip((*names, *others), (*interval(own), *interval(pairs)), strict=True))


def _comparison(
    points: Sequence[Sequence[float]], robust: Sequence[Sequence[float]]
) -> list[dict[str, float]]:
    """A row for each tree, with mean and worst of the perturbed worlds if there are such."""
    rows = [_compared(tree_points, points[0]) for tree_points in points]
    for row, tree_points in zip(rows, robust, strict=False):
        row |= {"perturbed": fmean(tree_points), "perturbed_worst": min(tree_points)}
    return rows


def _print_comparison(
    names: Sequence[str],
    points: Sequence[Sequence[float]],
    robust: Sequence[Sequence[float]],
    settings: Settings,
) -> None:
    """Prints one row per tree; long names are printed above the table."""
    rows = _comparison(points, robust)
    worlds = len(points[0])
    wins = [sum(a > b for a, b in zip(own, points[0], strict=True)) for own in points]
    better = [f"{count} of {worlds}" for count in wins]
    columns = [
        Column("tree", tuple(names), right=False),
        Column("fitness (95 %)", _with_intervals(rows, "fitness", worlds), right=False),
        Column(
            "difference (95 %)",
            ("", *_with_intervals(rows[1:], "difference", worlds, signed=True)),
            right=False,
        ),
        Column("better in", ("", *better[1:])),
    ]
    if robust:
        columns += [
            Column("perturbed", tuple(numbers([row["perturbed"] for row in rows]))),
            Column("worst", tuple(numbers([row["perturbed_worst"] for row in rows]))),
        ]
    console = standard_output()
    if width_of(columns) > console.width:
        for number, name in enumerate(names, 1):
            console.print(f"tree {number}: {name}")
        console.print()
        columns[0] = Column("tree", tuple(str(number) for number in range(1, len(names) + 1)))
    print_table(console, columns)
    if worlds > 1:
        console.print(
            f"\nMeans over the worlds 0 to {worlds - 1}; differences are to the first tree in the"
            " same worlds, with Student's t."
        )
    else:
        console.print("\nOne world has no interval; --seeds N takes more.")
    if settings.perturb is not None:
        words = settings.perturb.in_words()
        console.print(f"Perturbed: mean and worst in the same worlds with {words}.")


def _with_intervals(
    rows: Sequence[dict[str, float]], what: str, worlds: int, *, signed: bool = False
) -> tuple[str, ...]:
    """Means of `fitness` or `difference`, each with its interval; a dash where there is none."""
    flat = numbers([row[what + end] for row in rows for end in ("", "_low", "_high")])
    if signed:
        flat = [text if text[0] == "-" else f"+{text}" for text in flat]
    columns = flat[::3], flat[1::3], flat[2::3]
    mean, low, high = (max(map(len, cells), default=0) for cells in columns)
    return tuple(
        f"{a:>{mean}} ({b:>{low}} to {c:>{high}})" if worlds > 1 else f"{a:>{mean}} (-)"
        for a, b, c in zip(*columns, strict=True)
    )


def _outcomes(
    tree: Node, settings: Settings, seeds: int, stage: int, *, perturbed: bool = False
) -> list[Outcome]:
    """The outcomes in the worlds 0 to seeds - 1, with a progress bar where there is a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    from islandgp.evaluation.base import KEPT, Job
    from islandgp.running.run import make_evaluator

    jobs = [Job(to_text(tree), stage, seed) for seed in range(seeds)]
    if seeds < 4:  # quicker than starting processes
        settings = _serial(settings)
    outcomes: list[Outcome] = []
    console = Console(stderr=True)
    bar = Progress(console=console, disable=not console.is_terminal, transient=True)
    with closing(make_evaluator(settings, perturbed=perturbed)) as evaluator, bar:
        task = bar.add_task("episodes", total=seeds)
        for start in range(0, seeds, 16):
            try:
                outcomes += evaluator.evaluate(jobs[start : start + 16])
            except EvaluationError as error:  # the tree is that of the file
                raise EvaluationError(str(error).partition(KEPT)[0]) from error
            bar.update(task, completed=len(outcomes))
    return outcomes


def _limited(settings: Settings, seconds: float) -> Settings:
    """The settings with an evaluator that takes so long for an episode, where it has a limit."""
    part = settings.evaluator
    if "episode_timeout" not in part.factory.Settings.model_fields:
        return settings
    limit = {**part.policy, "episode_timeout": min(seconds, MOST_SECONDS)}
    evaluator = part.model_copy(update={"policy": limit})
    return settings.model_copy(update={"evaluator": evaluator})


def _serial(settings: Settings) -> Settings:
    """The settings with the evaluator of this process, and the limit that there is."""
    policy = {k: v for k, v in settings.evaluator.policy.items() if k == "episode_timeout"}
    serial = settings.evaluator.model_validate(
        {"factory": "islandgp.evaluation.serial:Serial", "cache": False, "policy": policy}
    )
    return settings.model_copy(update={"evaluator": serial})


def _print(
    outcomes: Sequence[Outcome],
    schema: Schema,
    settings: Settings,
    stage: int,
    perturbed: Sequence[float],
) -> None:
    from islandgp.scoring.classes import tiers

    console = standard_output()
    columns, left_out = fitting(_columns(outcomes, schema, settings, perturbed), console.width)
    print_table(console, columns)
    if left_out:
        console.print(f"Not shown, for want of room: {', '.join(left_out)}.", style="dim")
    console.print()
    print_table(console, _summary(f"points, stage {stage + 1}", _points(outcomes)))
    if schema.counters:
        console.print()
        print_table(console, _summary("counters", _counts(outcomes, schema)))
    console.print()
    reached = [tiers(outcome, settings.classes) for outcome in outcomes]
    counts = [f"{tier} {sum(tier in r for r in reached)}" for tier in settings.classes.tiers]
    console.print(
        f"Tiers, of {len(outcomes)} world{'s' * (len(outcomes) > 1)}: {', '.join(counts)}"
    )
    if settings.perturb is not None:
        worst = min(range(len(perturbed)), key=lambda k: perturbed[k])
        mean, least = numbers([fmean(perturbed), perturbed[worst]])
        words = settings.perturb.in_words()
        console.print(f"With {words}: mean {mean} points, worst {least} in world {worst}")
    if len(outcomes) == 1:
        console.print("One world has no standard deviation; --seeds N takes more.")


def _columns(
    outcomes: Sequence[Outcome], schema: Schema, settings: Settings, perturbed: Sequence[float]
) -> list[Column]:
    """The columns of a table with one row per world."""
    from islandgp.scoring.classes import specialist, tiers

    classes = settings.classes
    best = [tiers(outcome, classes)[:1] for outcome in outcomes]
    return [
        Column("world", tuple(map(str, range(len(outcomes))))),
        Column("fitness", tuple(numbers([outcome.fitness for outcome in outcomes]))),
        *([Column("perturbed", tuple(numbers(perturbed)))] if perturbed else []),
        *(
            Column(name, tuple(numbers(values)), must=False)
            for name, values in _counts(outcomes, schema)
        ),
        Column("seconds", tuple(numbers([outcome.seconds for outcome in outcomes]))),
        Column("ended by", tuple(", ".join(o.endings) for o in outcomes), right=False),
        Column("class", tuple(specialist(o, classes) for o in outcomes), right=False),
        Column("best tier", tuple("".join(tier) for tier in best), right=False),
    ]


def _points(outcomes: Sequence[Outcome]) -> Named:
    """The points of each component in the worlds, and their sum."""
    for name in outcomes[0].components:
        yield name, [outcome.components[name] for outcome in outcomes]
    yield "fitness", [outcome.fitness for outcome in outcomes]


def _counts(outcomes: Sequence[Outcome], schema: Schema) -> Named:
    """The values of each counter in the worlds, by its heading."""
    for name, counter in schema.counters.items():
        unit = f" {counter.unit}" if counter.unit else ""
        yield f"{counter.heading or name}{unit}", [outcome.counters[name] for outcome in outcomes]


def _summary(title: str, rows: Named) -> list[Column]:
    """Mean and spread over the worlds, a row for each name."""
    names, values = zip(*rows, strict=True)
    cells = [numbers([fmean(v), stdev(v) if len(v) > 1 else nan, min(v), max(v)]) for v in values]
    headings = ("mean", "sd", "least", "most")
    columns = zip(headings, zip(*cells, strict=True), strict=True)
    return [Column(title, names, right=False), *(Column(*column) for column in columns)]
