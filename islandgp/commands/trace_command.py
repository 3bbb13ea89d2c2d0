"""`islandgp trace`: shows the ticks of each node in one episode."""

from __future__ import annotations

from math import inf

import click

from islandgp.commands.files import FILE
from islandgp.commands.options import EpisodeOptions, NumberRange, with_episode_options
from islandgp.commands.setting import recorded


@click.command()
@click.argument("file", type=FILE)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the world.")
@click.option(
    "--from", "begin", type=NumberRange(min=0), default=0.0, help="Start of the timeline, in s."
)
@click.option(
    "--to", "end", type=NumberRange(min=0), default=inf, help="End of the timeline, in s."
)
@with_episode_options
def command(file: str, seed: int, begin: float, end: float, episode: EpisodeOptions) -> None:
    """Run the tree in FILE in one world and show the ticks of each node.

    After each node: the share of ticks in which it was ticked, and how often it
    succeeded, failed and was aborted. Then the actions in order, with the points
    that they earned and the guards above them. `replay` shows the blackboard as well.
    """
    if not begin <= end:
        raise click.UsageError(f"expected --from before --to, found {begin:g} and {end:g}")
    from rich.console import Console

    from islandgp.viewer.trace import components, drawn, timeline

    recording = recorded(file, seed, episode)
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
    console.print()
    for text in components(recording):
        console.print(text)
