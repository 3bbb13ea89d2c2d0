"""`islandgp play`: runs trees in many worlds."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from math import nan
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any, Final

import click

from islandgp.bt.core.language import to_text
from islandgp.bt.core.node import Node
from islandgp.commands.files import FILE, display_name, read_tree_text
from islandgp.commands.options import EpisodeOptions, with_episode_options
from islandgp.commands.setting import stage_index, tree_in_domain
from islandgp.commands.tables import Column, numbers, print_table, standard_output
from islandgp.domain import Counter, Outcome, Schema
from islandgp.errors import EvaluationError
from islandgp.intervals import interval
from islandgp.plain import nan_to_none
from islandgp.scoring.classes import specialist, tiers
from islandgp.scoring.constraints import feasible_share, in_words
from islandgp.text import title

if TYPE_CHECKING:
    from islandgp.config.settings import Settings

MAX_SECONDS: Final = 1e6  # largest time limit of an episode, as for evaluators
ENDS: Final = ("", "_low", "_high")  # suffixes of the names of an estimate and its interval


@click.command()
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.option("--seeds", type=click.IntRange(1, 100_000), default=30, help="Number of worlds.")
@click.option("--json", "as_json", is_flag=True, help="Print the outcomes as JSON.")
@with_episode_options
def command(
    files: tuple[str, ...],
    seeds: int,
    as_json: bool,
    episode: EpisodeOptions,
) -> None:
    """Run the tree in each of FILES in the worlds 0, 1, 2, ...

    For one tree, the output has the counters of each world, the components of the
    fitness, and the quality tiers (Table 4 of the paper). Several trees are compared in
    the same worlds, by the paired differences to the first. Evolution uses other seeds. If the
    configuration perturbs worlds (--set 'perturb=...'), the fitness in the perturbed
    worlds is printed as well.
    """
    tree, settings, problem = tree_in_domain(files[0], episode.options)
    settings, stage = _limited(settings, episode.timeout), stage_index(settings, episode.stage)
    schema = problem.domain.schema
    trees = [tree, *(read_tree_text(file).tree(schema.vocabulary) for file in files[1:])]
    outcomes = _outcomes(trees, settings, seeds, stage)
    perturbed: list[list[float]] = []
    if settings.perturb:
        perturbed += map(_fitness, _outcomes(trees, settings, seeds, stage, perturbed=True))
    if len(files) == 1:
        rows = _world_rows(outcomes[0], *perturbed)
    else:
        rows = _comparison(outcomes, settings, perturbed)
        rows = [{"file": display_name(file), **row} for file, row in zip(files, rows, strict=True)]
    if as_json:
        click.echo(json.dumps(nan_to_none(rows), indent=2))
    elif len(files) == 1:
        _print(outcomes[0], schema, settings, stage, *perturbed)
    else:
        _print_comparison(rows, seeds, schema, settings)


def _fitness(outcomes: Sequence[Outcome]) -> list[float]:
    return [outcome.fitness for outcome in outcomes]


def _world_rows(outcomes: Sequence[Outcome], *perturbed: Sequence[float]) -> list[dict[str, Any]]:
    """A row for each world, with the fitness in the perturbed world if there is one."""
    rows = [{"fitness": outcome.fitness, **asdict(outcome)} for outcome in outcomes]
    for points in perturbed:
        rows = [{**row, "perturbed": value} for row, value in zip(rows, points, strict=True)]
    return rows


def _comparison(
    outcomes: Sequence[Sequence[Outcome]],
    settings: Settings,
    perturbed: Sequence[Sequence[float]],
) -> list[dict[str, Any]]:
    """A row for each tree: means with 95 % intervals, whose ends are nan for a single world.

    Counters are means over the worlds; tiers and constraints are shares of the worlds.
    """
    rows = []
    for own in outcomes:
        points = _fitness(own)
        pairs = [a - b for a, b in zip(points, _fitness(outcomes[0]), strict=True)]
        reached = [tiers(outcome, settings.classes) for outcome in own]
        row: dict[str, Any] = dict(
            zip((f"fitness{end}" for end in ENDS), interval(points), strict=True)
        )
        row |= zip((f"difference{end}" for end in ENDS), interval(pairs), strict=True)
        row["better_in"] = sum(pair > 0 for pair in pairs)
        row["counters"] = {name: fmean(o.counters[name] for o in own) for name in own[0].counters}
        row["tiers"] = {
            tier: fmean(tier in names for names in reached) for tier in settings.classes.tiers
        }
        if settings.constraints:
            row["feasible"] = feasible_share([o.counters for o in own], settings.constraints)
        rows.append(row)
    for row, values in zip(rows, perturbed, strict=False):
        row |= {"perturbed": fmean(values), "perturbed_worst": min(values)}
    return rows


def _print_comparison(
    rows: Sequence[dict[str, Any]], worlds: int, schema: Schema, settings: Settings
) -> None:
    """Prints one row for each tree: fitness, then tiers, constraints and counters."""
    fitness, difference = (_with_intervals(rows, name) for name in ("fitness", "difference"))
    better = [f"{row['better_in']} of {worlds}" for row in rows[1:]]
    columns = [
        Column("tree", [row["file"] for row in rows], left=True),
        Column("fitness (95 %)", fitness, left=True),
        Column("difference (95 %)", ["", *difference[1:]], left=True),
        Column("better in", ["", *better]),
    ]
    if settings.perturb:
        for heading, name in (("perturbed", "perturbed"), ("worst", "perturbed_worst")):
            columns.append(Column(heading, numbers([row[name] for row in rows])))
    files, console = columns[0], standard_output()
    print_table(console, columns)
    shares = {title(tier): [row["tiers"][tier] for row in rows] for tier in settings.classes.tiers}
    if settings.constraints:
        shares["constraints kept"] = [row["feasible"] for row in rows]
    counters = [
        Column(_heading(key, counter), numbers([row["counters"][key] for row in rows]))
        for key, counter in schema.counters.items()
    ]
    console.print()
    print_table(console, [files, *(Column(k, [f"{v:.0%}" for v in s]) for k, s in shares.items())])
    if counters:
        console.print()
        print_table(console, [files, *counters])
    if settings.constraints:
        console.print(f"\nConstraints: {in_words(settings.constraints)}.")
    if worlds > 1:
        console.print(
            f"\nMeans over the worlds 0 to {worlds - 1}; differences are to the first tree in the"
            " same worlds, with Student's t. Tiers are shares of the worlds."
        )
    else:
        console.print("\nOne world has no interval; --seeds N takes more.")
    if settings.perturb:
        perturbation = settings.perturb.in_words()
        console.print(f"Perturbed: mean and worst in the same worlds with {perturbation}.")


def _with_intervals(rows: Sequence[dict[str, Any]], name: str) -> list[str]:
    """Means of `fitness` or `difference`, each with its interval; a dash if there is none."""
    texts = numbers([row[name + end] for row in rows for end in ENDS])
    if name == "difference":
        texts = [text if text[0] == "-" else f"+{text}" for text in texts]
    columns = texts[::3], texts[1::3], texts[2::3]
    mean, low, high = (max(map(len, cells)) for cells in columns)
    return [
        f"{a:>{mean}} (-)" if b == "-" else f"{a:>{mean}} ({b:>{low}} to {c:>{high}})"
        for a, b, c in zip(*columns, strict=True)
    ]


def _outcomes(
    trees: Sequence[Node], settings: Settings, seeds: int, stage: int, *, perturbed: bool = False
) -> list[list[Outcome]]:
    """Each tree's outcomes in the worlds 0 to seeds - 1, with a progress bar on a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    from islandgp.evaluation.base import TREE_INTRODUCTION, Job
    from islandgp.running.parts import make_evaluator

    jobs = [Job(to_text(tree), stage, seed) for tree in trees for seed in range(seeds)]
    if seeds < 4:  # faster than starting processes
        settings = _serial(settings)
    outcomes: list[Outcome] = []
    console = Console(stderr=True)
    bar = Progress(console=console, disable=not console.is_terminal, transient=True)
    with closing(make_evaluator(settings, perturbed=perturbed)) as evaluator, bar:
        task = bar.add_task("episodes", total=len(jobs))
        for start in range(0, len(jobs), 16):
            try:
                outcomes += evaluator.evaluate(jobs[start : start + 16])
            except EvaluationError as error:  # the tree is that of the file
                raise EvaluationError(str(error).partition(TREE_INTRODUCTION)[0]) from error
            bar.update(task, completed=len(outcomes))
    return [outcomes[start : start + seeds] for start in range(0, len(jobs), seeds)]


def _limited(settings: Settings, seconds: float) -> Settings:
    """The settings with a time limit of episodes, if the evaluator has such a setting."""
    part = settings.evaluator
    if "episode_timeout" not in part.factory.Settings.model_fields:
        return settings
    limit = {**part.policy, "episode_timeout": min(seconds, MAX_SECONDS)}
    evaluator = part.model_copy(update={"policy": limit})
    return settings.model_copy(update={"evaluator": evaluator})


def _serial(settings: Settings) -> Settings:
    """The settings with the evaluator of this process, and the same time limit."""
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
    *perturbed: Sequence[float],
) -> None:
    console, classes = standard_output(), settings.classes
    reached = [tiers(outcome, classes) for outcome in outcomes]
    counters = list(_counters(outcomes, schema))
    points = [
        *((name, [o.components[name] for o in outcomes]) for name in outcomes[0].components),
        ("fitness", _fitness(outcomes)),
    ]
    columns = [
        Column("world", [str(world) for world in range(len(outcomes))]),
        Column("fitness", numbers(_fitness(outcomes))),
        *(Column("perturbed", numbers(values)) for values in perturbed),
        *(Column(heading, numbers(values)) for heading, values in counters),
        Column("seconds", numbers([outcome.seconds for outcome in outcomes])),
        Column("ended by", [", ".join(outcome.endings) for outcome in outcomes], left=True),
        Column("class", [specialist(outcome, classes) for outcome in outcomes], left=True),
        Column("best tier", ["".join(names[:1]) for names in reached], left=True),
    ]
    summaries = [_summary(f"points, stage {stage + 1}", points)]
    if counters:
        summaries.append(_summary("counters", counters))
    for table in (columns, *summaries):
        print_table(console, table)
        console.print()
    counts = [f"{tier} {sum(tier in names for names in reached)}" for tier in classes.tiers]
    console.print(
        f"Tiers, of {len(outcomes)} world{'s' * (len(outcomes) > 1)}: {', '.join(counts)}"
    )
    for values in perturbed:
        mean, least = numbers([fmean(values), min(values)])
        perturbation = settings.perturb.in_words() if settings.perturb else ""
        world = values.index(min(values))
        console.print(f"With {perturbation}: mean {mean} points, worst {least} in world {world}")
    if len(outcomes) == 1:
        console.print("One world has no standard deviation; --seeds N takes more.")


def _counters(outcomes: Sequence[Outcome], schema: Schema) -> Iterator[tuple[str, list[float]]]:
    """The heading of each counter, and its values in the worlds."""
    for name, counter in schema.counters.items():
        yield _heading(name, counter), [outcome.counters[name] for outcome in outcomes]


def _heading(name: str, counter: Counter) -> str:
    return f"{counter.heading or name} {counter.unit}".rstrip()


def _summary(title: str, rows: Sequence[tuple[str, Sequence[float]]]) -> list[Column]:
    """Mean and spread over the worlds, a row for each name."""
    names, values = zip(*rows, strict=True)
    cells = [numbers([fmean(v), stdev(v) if len(v) > 1 else nan, min(v), max(v)]) for v in values]
    columns = zip(("mean", "sd", "least", "most"), zip(*cells, strict=True), strict=True)
    return [Column(title, names, left=True), *(Column(*column) for column in columns)]
