"""`islandgp explain`: what each branch of a tree does, and what is lost without it."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path

import click

from islandgp.bt.core.node import names_in
from islandgp.bt.core.printer import with_subtrees
from islandgp.commands.evaluating import tree_trials
from islandgp.commands.files import FILE
from islandgp.commands.options import EpisodeOptions, with_episode_options
from islandgp.commands.tables import standard_output
from islandgp.evolution.validation import fresh_worlds
from islandgp.plain import nan_to_none
from islandgp.records.folder import RunFolder
from islandgp.records.sentences import in_lines
from islandgp.scoring.explain import explained, usage, with_counts, with_losses


@click.command()
@click.argument("file", type=FILE)
@click.option("--worlds", type=click.IntRange(1, 10_000), default=20, help="Number of worlds.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the worlds.")
@click.option("--text", "as_text", is_flag=True, help="Print the tree with comments instead.")
@click.option("--json", "as_json", is_flag=True, help="Print a row per node as JSON.")
@with_episode_options
def command(
    file: str, worlds: int, seed: int, as_text: bool, as_json: bool, episode: EpisodeOptions
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
    with tree_trials(file, episode, worlds) as trials:
        tree = trials.tree
        usages = usage(trials.problem.run(trials.stage), tree, seeds)
        usages = with_losses(usages, tree, trials.outcomes, seeds)
    if as_json:
        click.echo(json.dumps(nan_to_none([asdict(u) for u in usages]), indent=2))
    elif as_text:
        click.echo(with_subtrees(explained(tree, usages)), nl=False)
    else:
        notes = [Text(with_counts(u), "dim" if u.worlds else "bold red") for u in usages]
        standard_output().print(to_rich(tree, notes))
        run, actions = RunFolder(Path(file).parent), names_in(tree)[0]
        learned = run.summary().get("learned", ()) if run.finished() else ()
        if own := [s for s in learned if re.split(r"\W", s, maxsplit=1)[0] in actions]:
            click.echo("\n".join(in_lines(own)))
