"""Commands that run trees: `play`, `explain`, `prune` and `replay`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import nan
from pathlib import Path
from statistics import fmean, stdev
from typing import TYPE_CHECKING

import click

from islandgp.bt.analysis.names import with_names
from islandgp.bt.core.language import domain_of
from islandgp.bt.core.node import actions_in, size
from islandgp.bt.core.parameters import spelled_out
from islandgp.bt.core.printer import with_subtrees
from islandgp.commands.files import (
    FILE,
    OUTPUT,
    check_other_file,
    display_name,
    read_tree_text,
    write_text,
)
from islandgp.commands.options import DomainOptions, with_episode_options, with_output_option
from islandgp.commands.setting import tree_task
from islandgp.commands.tables import (
    Column,
    compared_trees,
    numbers,
    print_table,
    standard_output,
    with_ends,
)
from islandgp.compare.champions import compared, episode_frame
from islandgp.domain import Outcome, Schema
from islandgp.evolution.prune import LEAST_EPISODES, Keep, PruneResult, prune
from islandgp.evolution.validation import fresh_worlds
from islandgp.plain import to_json
from islandgp.records.folder import RunFolder
from islandgp.records.values import in_lines
from islandgp.scoring.classes import specialist, tiers
from islandgp.scoring.constraints import in_words
from islandgp.scoring.explain import explained, usage, with_counts, with_losses
from islandgp.statistics import mean_interval
from islandgp.text import in_its_domain

if TYPE_CHECKING:
    from islandgp.config.settings import Settings

with_seed_option = click.option(
    "--seed", type=click.IntRange(0), default=0, help="Seed of the world, or of all worlds."
)


@click.command()
@click.argument("files", type=FILE, nargs=-1, required=True)
@click.option(
    "--seeds", "--worlds", type=click.IntRange(1, 100_000), default=30, help="Number of worlds."
)
@click.option("--json", "as_json", is_flag=True, help="Print the outcomes as JSON.")
@with_episode_options
def play_command(files: tuple[str, ...], seeds: int, as_json: bool, options: DomainOptions) -> None:
    """Run the tree in each of FILES in the worlds 0, 1, 2, ...

    For one tree, the output has the counters of each world, the components of the
    fitness, and the quality tiers (Table 4 of the paper). Several trees are compared in
    the same worlds, by the paired differences to the first. Evolution uses other seeds. If the
    configuration perturbs worlds (--set 'perturb=...'), the episodes run in perturbed ones.
    """
    task = tree_task(files[0], options)
    settings, schema = task.settings, task.problem.domain.schema
    trees = [task.tree, *(read_tree_text(file).tree(schema.vocabulary) for file in files[1:])]
    with task.trials(len(files) * seeds) as trials:
        outcomes = trials(trees, range(seeds))
    first, reached = outcomes[0], [tiers(each, settings.classes) for each in outcomes[0]]
    rows = [{"fitness": o.fitness, **asdict(o)} for o in first]
    if len(files) > 1:
        table = episode_frame(range(len(files)), outcomes, settings.classes, settings.constraints)
        frame = compared(table).assign(name=[*map(display_name, files)])
        rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    console = standard_output()
    if len(files) == 1:
        print_table(console, _worlds(first, schema, settings))
        console.print()
        print_table(console, _summary(first, schema))
        counts = (f"{t} {sum(t in names for names in reached)}" for t in settings.classes.tiers)
        console.print(
            f"\nStage {task.stage + 1}. Tiers, of {seeds} world{'s' * (seeds > 1)}:"
            f" {', '.join(counts)}"
        )
    else:
        print_table(console, compared_trees(frame, seeds, _headings(schema)))
        console.print(
            f"\nMeans over the worlds 0 to {seeds - 1}; differences are to the first tree in the"
            " same worlds, with Student's t. Tiers are shares of the worlds."
        )
    if settings.constraints:
        console.print(f"Constraints: {in_words(settings.constraints)}.")
    if settings.perturb:
        console.print(f"Perturbed: {settings.perturb.in_words()}.")


def _worlds(outcomes: Sequence[Outcome], schema: Schema, settings: Settings) -> Iterator[Column]:
    """A row for each world."""
    classes = settings.classes
    yield "world", [str(world) for world in range(len(outcomes))]
    yield "fitness", [outcome.fitness for outcome in outcomes]
    for name, heading in _headings(schema):
        yield heading, [outcome.counters[name] for outcome in outcomes]
    yield "seconds", [outcome.seconds for outcome in outcomes]
    yield "ended by", [", ".join(outcome.endings) for outcome in outcomes]
    yield "class", [specialist(outcome, classes) for outcome in outcomes]
    yield "best tier", ["".join(tiers(outcome, classes)[:1]) for outcome in outcomes]


def _headings(schema: Schema) -> Iterator[tuple[str, str]]:
    """The name and the heading of each counter."""
    for name, counter in schema.counters.items():
        yield name, f"{counter.heading or name} {counter.unit}".rstrip()


def _summary(outcomes: Sequence[Outcome], schema: Schema) -> list[Column]:
    """Mean and spread over the worlds of the components, the fitness and the counters."""
    rows = {name: [o.components[name] for o in outcomes] for name in outcomes[0].components}
    rows["fitness"] = [outcome.fitness for outcome in outcomes]
    rows |= {heading: [o.counters[n] for o in outcomes] for n, heading in _headings(schema)}
    cells = [
        numbers([fmean(v), stdev(v) if len(v) > 1 else nan, min(v), max(v)]) for v in rows.values()
    ]
    columns = zip(("mean", "sd", "least", "most"), zip(*cells, strict=True), strict=True)
    return [("points", list(rows)), *columns]


@click.command()
@click.argument("file", type=FILE)
@click.option(
    "--worlds", "--seeds", type=click.IntRange(1, 10_000), default=20, help="Number of worlds."
)
@with_seed_option
@click.option("--text", "as_text", is_flag=True, help="Print the tree with comments instead.")
@click.option("--json", "as_json", is_flag=True, help="Print a row per node as JSON.")
@with_episode_options
def explain_command(
    file: str, worlds: int, seed: int, as_text: bool, as_json: bool, options: DomainOptions
) -> None:
    """Explain the tree in FILE: what each node does over several worlds.

    For each node: the share of worlds in which it runs (a guard runs if its child does), its ticks,
    successes and failures in an episode, the points that the actions below it earn, and how many
    points change without it, with a 95 % interval over the worlds.

    For a tree in the folder of a run with search=plans, what the run has learned about its actions
    follows.
    """
    from rich.text import Text

    from islandgp.bt.export.render import to_rich

    seeds = fresh_worlds(seed)(worlds)
    task = tree_task(file, options)
    tree = task.tree
    with task.trials(worlds) as trials:
        usages = with_losses(usage(task.problem.run(task.stage), tree, seeds), tree, trials, seeds)
    if as_json:
        click.echo(json.dumps([to_json(u) for u in usages], indent=2))
    elif as_text:
        click.echo(with_subtrees(explained(tree, usages)), nl=False)
    else:
        notes = [Text(with_counts(u), "dim" if u.worlds else "bold red") for u in usages]
        schema = task.problem.domain.schema
        shown = spelled_out(tree, lambda name: schema.vocabulary.action(name).arguments)
        standard_output().print(to_rich(shown, notes))
        run, actions = RunFolder(Path(file).parent), actions_in(tree)
        learned = run.summary().get("learned", ()) if run.finished() else ()
        if own := [s for s in learned if re.split(r"\W", s, maxsplit=1)[0] in actions]:
            click.echo("\n".join(in_lines(own)))


@click.command()
@click.argument("file", type=FILE)
@with_output_option
@click.option(
    "--episodes",
    type=click.IntRange(LEAST_EPISODES, 1_000_000),
    default=3_000,
    help="Maximum number of episodes.",
)
@with_seed_option
@with_episode_options
def prune_command(file: str, output: str, episodes: int, seed: int, options: DomainOptions) -> None:
    """Shorten the tree in FILE as far as its fitness allows.

    Nodes, terms and digits go if the tree keeps its fitness within a tolerance (--set
    prune.tolerance=SHARE), and its tiers, behaviours and constraints, in the same worlds. The trees
    on the way are then evaluated in fresh worlds; the shortest one that is as good there is
    printed, or written with -o. What went is reported on the standard error. `simplify` makes only
    changes that cannot be noticed.
    """
    check_other_file(file, output)
    task = tree_task(file, options)
    settings, vocabulary = task.settings, task.problem.domain.schema.vocabulary
    with task.trials(episodes) as trials:
        result = prune(
            task.tree,
            vocabulary,
            trials,
            task.problem.run(task.stage),
            fresh_worlds(seed),
            Keep(settings.prune.tolerance, settings.classes, settings.constraints),
            episodes=episodes,
            most_worlds=settings.prune.worlds,
        )
    best = with_names(result.best, vocabulary, [task.tree])
    write_text(output, in_its_domain(domain_of(task.source.text), with_subtrees(best)))
    _report(result)


def _report(result: PruneResult) -> None:
    """Two tables: the steps with their differences, and the trees in fresh worlds."""
    from rich.console import Console

    console = Console(stderr=True, highlight=False, markup=False)
    if result.earns_nothing:
        console.print("The tree earns 0 points in every world, so there is nothing to compare.")
        return
    steps: list[Column] = [
        ("nodes", [size(step.tree) for step in result.steps]),
        ("points", ["", *numbers([step.difference for step in result.steps[1:]], "+")]),
        ("change", [step.change or "simplified" for step in result.steps]),
    ]
    print_table(console, steps)
    if tried := result.front:
        console.print("\nShorter trees in fresh worlds; differences are to the original:")
        front: list[Column] = [
            ("nodes", [size(each.tree) for each in tried]),
            ("difference (95 %)", [with_ends(mean_interval(t.differences), "+") for t in tried]),
            ("worlds", [len(each.differences) for each in tried]),
            ("", ["chosen" if each.tree == result.best else "" for each in tried]),
        ]
        print_table(console, front)
    console.print(
        f"Nodes: {size(result.original)} before, {size(result.best)} after;"
        f" {result.episodes:,} episodes"
    )


@click.command()
@click.argument("file", type=FILE)
@with_seed_option
@click.option("-o", "--output", type=OUTPUT, default="replay.html")
@with_episode_options
def replay_command(file: str, seed: int, output: str, options: DomainOptions) -> None:
    """Run the tree in FILE in one world, and write a page that shows it.

    The page is self-contained: open it in a browser, send it by mail, or view it
    as an artifact in MLflow.
    """
    from islandgp.viewer.page import page
    from islandgp.viewer.recording import record

    check_other_file(file, output)
    task = tree_task(file, options, unread="evaluator")
    recording = record(task.tree, task.problem, seed=seed, stage=task.stage, limit=task.timeout)
    text = page(recording, title=Path(display_name(file)).stem)
    write_text(output, text)
