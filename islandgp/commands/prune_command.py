"""`islandgp prune`: shortens a tree as far as its fitness allows."""

from __future__ import annotations

from collections.abc import Sequence

import click

from islandgp.bt.analysis.names import with_names
from islandgp.bt.core.language import domain_of
from islandgp.bt.core.node import size
from islandgp.bt.core.printer import with_subtrees
from islandgp.commands.evaluating import tree_trials
from islandgp.commands.files import FILE, check_other_file, write_text
from islandgp.commands.options import (
    EpisodeOptions,
    NumberRange,
    with_episode_options,
    with_output_option,
)
from islandgp.commands.tables import Column, numbers, print_table
from islandgp.evolution.prune import LEAST_EPISODES, Keep, PruneResult, prune
from islandgp.evolution.validation import fresh_worlds
from islandgp.statistics import mean_interval


@click.command()
@click.argument("file", type=FILE)
@with_output_option
@click.option(
    "--tolerance",
    type=NumberRange(min=0, max=0.5),
    help="Largest loss of mean fitness, as a share of it; by default that of the configuration.",
)
@click.option(
    "--episodes",
    type=click.IntRange(LEAST_EPISODES, 1_000_000),
    default=3_000,
    help="Maximum number of episodes.",
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the worlds.")
@with_episode_options
def command(
    file: str,
    output: str,
    tolerance: float | None,
    episodes: int,
    seed: int,
    episode: EpisodeOptions,
) -> None:
    """Shorten the tree in FILE as far as its fitness allows.

    Nodes, terms and digits go if the tree keeps its fitness within the tolerance, and its tiers,
    behaviours and constraints, in the same worlds. The trees on the way are then evaluated in
    fresh worlds; the shortest one that is as good there is printed, or written with -o. What went
    is reported on the standard error. `simplify` makes only changes that cannot be noticed.
    """
    check_other_file(file, output)
    with tree_trials(file, episode, episodes) as trials:
        settings, vocabulary = trials.settings, trials.problem.domain.schema.vocabulary
        limit = settings.prune.tolerance if tolerance is None else tolerance
        result = prune(
            trials.tree,
            vocabulary,
            trials.outcomes,
            trials.problem.run(trials.stage),
            fresh_worlds(seed),
            Keep(limit, settings.classes, settings.constraints),
            episodes=episodes,
            most_worlds=settings.prune.worlds,
        )
    domain = domain_of(trials.source.text)
    best = with_names(result.best, vocabulary, [trials.tree])
    write_text(output, (f"domain {domain}\n\n" if domain else "") + with_subtrees(best))
    _report(result)


def _report(result: PruneResult) -> None:
    """Two tables: the steps with their differences, and the trees in fresh worlds."""
    from rich.console import Console

    console = Console(stderr=True, highlight=False, markup=False)
    if result.earns_nothing:
        console.print("The tree earns 0 points in every world, so there is nothing to compare.")
        return
    first, *steps = result.steps
    columns = [
        Column("nodes", [str(size(step.tree)) for step in (first, *steps)]),
        Column("points", ["", *_signed([step.difference for step in steps])]),
        Column("change", [s.change or "simplified" for s in (first, *steps)], left=True),
    ]
    print_table(console, columns)
    if result.front:
        console.print("\nShorter trees in fresh worlds; differences are to the original:")
        intervals = [mean_interval(tried.differences) for tried in result.front]
        cells = [_signed([each[end] for each in intervals]) for end in range(3)]
        chosen = ["chosen" if tried.tree == result.best else "" for tried in result.front]
        texts = [f"{a} ({b} to {c})" for a, b, c in zip(*cells, strict=True)]
        table = [
            Column("nodes", [str(size(tried.tree)) for tried in result.front]),
            Column("difference (95 %)", texts, left=True),
            Column("worlds", [str(len(tried.differences)) for tried in result.front]),
            Column("", chosen, left=True),
        ]
        print_table(console, table)
    console.print(
        f"Nodes: {size(result.original)} before, {size(result.best)} after;"
        f" {result.episodes:,} episodes"
    )


def _signed(values: Sequence[float]) -> list[str]:
    """Numbers with a sign, with as many decimals as they need."""
    return [text if text[0] == "-" else f"+{text}" for text in numbers(values)]
