"""`islandgp trace`: which nodes of a tree did what in one episode, and why."""

from __future__ import annotations

from math import inf

import click

from islandgp.commands.files import FILE, read_tree
from islandgp.commands.setting import configured, stage_index, with_island_options


@click.command()
@click.argument("file", type=FILE)
@click.option("--seed", type=click.IntRange(0), default=0, help="Of the world; default: 0.")
@click.option(
    "--from", "begin", type=click.FloatRange(0), default=0.0, help="Start of the timeline, in s."
)
@click.option("--to", "end", type=click.FloatRange(0), default=inf, help="End of it, in s.")
@with_island_options
def command(
    file: str,
    seed: int,
    begin: float,
    end: float,
    overrides: tuple[str, ...],
    config_dir: str | None,
    stage: int | None,
) -> None:
    """Run the tree in FILE in one world, and tell what each node did.

    Behind each node: the share of the time in which it was ticked, and how often
    it succeeded, failed and was aborted. Then what the actions did, in order,
    with the points they won and the guards above them; then the blackboard.
    """
    if not begin <= end:
        raise click.UsageError(f"expected --from before --to, found {begin:g} and {end:g}")
    from rich.console import Console

    from islandgp.scoring.rewards import Component
    from islandgp.viewer.recording import record
    from islandgp.viewer.trace import courses, drawn, timeline

    tree = read_tree(file)
    settings = configured(overrides, config_dir)
    recording = record(tree, settings, seed=seed, stage=stage_index(settings, stage))
    console = Console(soft_wrap=True, highlight=False)
    episode = recording.episode
    console.print(
        f"World {seed}, stage {recording.stage + 1}: {episode.fitness:,.0f} points in"
        f" {recording.seconds:.0f} s, ended by {episode.ending.value}\n"
    )
    console.print(drawn(recording))
    console.print("\n  start     lasted    action                 result               points")
    for line in timeline(recording):
        at = float(line.plain.split()[0])
        if begin <= at <= end:
            console.print(line)
    console.print()
    for course in courses(recording):
        console.print(course)
    console.print()
    for component in Component:
        won = sum(c.points for c in recording.credits if c.component is component)
        if won:
            console.print(f"{component.name.lower():<12}{won:+10,.0f}")
