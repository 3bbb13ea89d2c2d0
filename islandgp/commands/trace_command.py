"""`islandgp trace`: which nodes of a tree did what in one episode, and why."""

from __future__ import annotations

from math import inf

import click

from islandgp.commands.files import FILE
from islandgp.commands.setting import (
    Chosen,
    NotNegative,
    stage_index,
    tree_in_domain,
    with_domain_options,
    with_stage_option,
    with_timeout_option,
)


@click.command()
@click.argument("file", type=FILE)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the world; default: 0.")
@click.option(
    "--from", "begin", type=NotNegative(), default=0.0, help="Start of the timeline, in s."
)
@click.option("--to", "end", type=NotNegative(), default=inf, help="End of it, in s.")
@with_domain_options
@with_stage_option
@with_timeout_option
def command(
    file: str,
    seed: int,
    begin: float,
    end: float,
    chosen: Chosen,
    stage: int | None,
    timeout: float,
) -> None:
    """Run the tree in FILE in one world and show the ticks of each node.

    After each node: the share of ticks in which it was ticked, and how often it
    succeeded, failed and was aborted. Then the actions in order, with the points
    that they earned and the guards above them; then the blackboard.
    """
    if not begin <= end:
        raise click.UsageError(f"expected --from before --to, found {begin:g} and {end:g}")
    from rich.console import Console

    from islandgp.viewer.recording import record
    from islandgp.viewer.trace import components, courses, drawn, timeline

    tree, settings, problem = tree_in_domain(file, chosen)
    index = stage_index(settings, stage)
    recording = record(tree, problem, seed=seed, stage=index, limit=timeout)
    console = Console(soft_wrap=True, highlight=False)
    outcome = recording.outcome
    console.print(
        f"World {seed}, stage {recording.stage + 1}: {outcome.fitness:,.{recording.digits}f}"
        f" points in {outcome.seconds:,g} s, ended by {', '.join(outcome.endings)}\n"
    )
    console.print(drawn(recording))
    console.print()
    for line in timeline(recording, begin, end):
        console.print(line)
    for part in (courses(recording), components(recording)):
        console.print()
        for text in part:
            console.print(text)
