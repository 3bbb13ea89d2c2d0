"""`islandgp play`: runs trees in many worlds."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import nan
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any, Final

import click

from islandgp.commands.evaluating import tree_trials
from islandgp.commands.files import FILE, display_name, read_tree_text
from islandgp.commands.options import EpisodeOptions, with_episode_options
from islandgp.commands.tables import Column, numbers, print_table, standard_output
from islandgp.domain import Outcome, Schema
from islandgp.plain import nan_to_none
from islandgp.scoring.classes import specialist, tiers
from islandgp.scoring.constraints import feasible_share, in_words
from islandgp.statistics import mean_interval
from islandgp.text import title

if TYPE_CHECKING:
    from islandgp.config.settings import Settings

ENDS: Final = ("", "_low", "_high")  # suffixes of the names of an estimate and its interval


@click.command()
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.option("--seeds", type=click.IntRange(1, 100_000), default=30, help="Number of worlds.")
@click.option("--json", "as_json", is_flag=True, help="Print the outcomes as JSON.")
@with_episode_options
def command(files: tuple[str, ...], seeds: int, as_json: bool, episode: EpisodeOptions) -> None:
    """Run the tree in each of FILES in the worlds 0, 1, 2, ...

    For one tree, the output has the counters of each world, the components of the
    fitness, and the quality tiers (Table 4 of the paper). Several trees are compared in
    the same worlds, by the paired differences to the first. Evolution uses other seeds. If the
    configuration perturbs worlds (--set 'perturb=...'), the episodes run in perturbed ones.
    """
    with tree_trials(files[0], episode, len(files) * seeds) as trials:
        settings, schema = trials.settings, trials.problem.domain.schema
        others = [read_tree_text(file).tree(schema.vocabulary) for file in files[1:]]
        outcomes = trials.outcomes([trials.tree, *others], range(seeds))
    rows = [{"fitness": o.fitness, **asdict(o)} for o in outcomes[0]]
    if len(files) > 1:
        names = map(display_name, files)
        rows = [
            {"file": n, **_row(o, outcomes[0], settings)}
            for n, o in zip(names, outcomes, strict=True)
        ]
    if as_json:
        click.echo(json.dumps(nan_to_none(rows), indent=2))
        return
    columns = list(
        _worlds(outcomes[0], schema, settings)
        if len(files) == 1
        else _comparison(rows, seeds, schema, settings)
    )
    console = standard_output()
    print_table(console, columns)
    console.print()
    if len(files) == 1:
        print_table(console, _summary(outcomes[0], schema))
        reached = [tiers(outcome, settings.classes) for outcome in outcomes[0]]
        counts = (f"{t} {sum(t in names for names in reached)}" for t in settings.classes.tiers)
        console.print(
            f"\nStage {trials.stage + 1}. Tiers, of {seeds} world{'s' * (seeds > 1)}:"
            f" {', '.join(counts)}"
        )
    else:
        console.print(
            f"Means over the worlds 0 to {seeds - 1}; differences are to the first tree in the same"
            " worlds, with Student's t. Tiers are shares of the worlds."
        )
    if settings.constraints:
        console.print(f"Constraints: {in_words(settings.constraints)}.")
    if settings.perturb:
        console.print(f"Perturbed: {settings.perturb.in_words()}.")


def _worlds(outcomes: Sequence[Outcome], schema: Schema, settings: Settings) -> Iterator[Column]:
    """A row for each world."""
    classes = settings.classes
    yield Column("world", [str(world) for world in range(len(outcomes))])
    yield Column("fitness", numbers([outcome.fitness for outcome in outcomes]))
    for heading, values in _counters(outcomes, schema):
        yield Column(heading, numbers(values))
    yield Column("seconds", numbers([outcome.seconds for outcome in outcomes]))
    yield Column("ended by", [", ".join(outcome.endings) for outcome in outcomes], left=True)
    yield Column("class", [specialist(outcome, classes) for outcome in outcomes], left=True)
    best = ["".join(tiers(outcome, classes)[:1]) for outcome in outcomes]
    yield Column("best tier", best, left=True)


def _counters(outcomes: Sequence[Outcome], schema: Schema) -> Iterator[tuple[str, list[float]]]:
    """The heading of each counter, and its values in the worlds."""
    for name, counter in schema.counters.items():
        heading = f"{counter.heading or name} {counter.unit}".rstrip()
        yield heading, [outcome.counters[name] for outcome in outcomes]


def _summary(outcomes: Sequence[Outcome], schema: Schema) -> list[Column]:
    """Mean and spread over the worlds of the components, the fitness and the counters."""
    rows = {name: [o.components[name] for o in outcomes] for name in outcomes[0].components}
    rows["fitness"] = [outcome.fitness for outcome in outcomes]
    rows |= _counters(outcomes, schema)
    cells = [
        numbers([fmean(v), stdev(v) if len(v) > 1 else nan, min(v), max(v)]) for v in rows.values()
    ]
    columns = zip(("mean", "sd", "least", "most"), zip(*cells, strict=True), strict=True)
    return [Column("points", list(rows), left=True), *(Column(*column) for column in columns)]


def _row(own: Sequence[Outcome], first: Sequence[Outcome], settings: Settings) -> dict[str, Any]:
    """Means of a tree with 95 % intervals, whose ends are nan for a single world.

    Counters are means over the worlds; tiers and constraints are shares of the worlds.
    """
    points = [outcome.fitness for outcome in own]
    pairs = [a - b.fitness for a, b in zip(points, first, strict=True)]
    reached = [tiers(outcome, settings.classes) for outcome in own]
    row: dict[str, Any] = {}
    for name, values in (("fitness", points), ("difference", pairs)):
        row |= zip((name + end for end in ENDS), mean_interval(values), strict=True)
    row["better_in"] = sum(pair > 0 for pair in pairs)
    row["counters"] = {name: fmean(o.counters[name] for o in own) for name in own[0].counters}
    row["tiers"] = {tier: fmean(tier in t for t in reached) for tier in settings.classes.tiers}
    if settings.constraints:
        row["feasible"] = feasible_share([o.counters for o in own], settings.constraints)
    return row


def _comparison(
    rows: Sequence[dict[str, Any]], worlds: int, schema: Schema, settings: Settings
) -> Iterator[Column]:
    """A row for each tree: fitness, tiers, constraints and counters."""
    yield Column("tree", [row["file"] for row in rows], left=True)
    for name, sign in (("fitness", ""), ("difference", "+")):
        texts = [
            "{} ({} to {})".format(*_signed([row[name + end] for end in ENDS], sign))
            for row in rows
        ]
        shown = ["", *texts[1:]] if name == "difference" else texts
        yield Column(f"{name} (95 %)", shown, left=True)
    yield Column("better in", ["", *(f"{row['better_in']} of {worlds}" for row in rows[1:])])
    for tier in settings.classes.tiers:
        yield Column(title(tier), [f"{row['tiers'][tier]:.0%}" for row in rows])
    if settings.constraints:
        yield Column("constraints kept", [f"{row['feasible']:.0%}" for row in rows])
    for name, counter in schema.counters.items():
        heading = f"{counter.heading or name} {counter.unit}".rstrip()
        yield Column(heading, numbers([row["counters"][name] for row in rows]))


def _signed(values: Sequence[float], sign: str) -> list[str]:
    return [text if text[0] == "-" else f"{sign}{text}" for text in numbers(values)]
