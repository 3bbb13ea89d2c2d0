"""`islandgp explain`: what each branch of a tree does, and what is lost without it."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import click

from islandgp.bt.core.node import Node, names_in
from islandgp.bt.core.printer import with_subtrees
from islandgp.commands.files import FILE
from islandgp.commands.options import DomainOptions, with_domain_options, with_stage_option
from islandgp.commands.setting import stage_index, tree_in_domain
from islandgp.commands.tables import standard_output
from islandgp.domain import Outcome
from islandgp.plain import nan_to_none
from islandgp.records.folder import RunFolder
from islandgp.records.sentences import in_lines
from islandgp.scoring.explain import NodeUsage, explained, usage, with_counts, with_losses


@click.command()
@click.argument("file", type=FILE)
@click.option("--worlds", type=click.IntRange(1, 10_000), default=20, help="Number of worlds.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the worlds.")
@click.option("--text", "as_text", is_flag=True, help="Print the tree with comments instead.")
@click.option("--json", "as_json", is_flag=True, help="Print a row per node as JSON.")
@with_domain_options
@with_stage_option
def command(
    file: str,
    worlds: int,
    seed: int,
    as_text: bool,
    as_json: bool,
    options: DomainOptions,
    stage: int | None,
) -> None:
    """Explain the tree in FILE: what each node does over several worlds.

    For each node: the share of worlds in which it runs (a guard runs if its child does), its ticks,
    successes and failures in an episode, the points that the actions below it earn, and how many
    points change without it, with a 95 % interval over the worlds.

    For a tree in the folder of a run whose search learns about actions, what it has learned
    follows.
    """
    from islandgp.evaluation.base import evaluated
    from islandgp.evolution.validation import fresh_worlds
    from islandgp.running.parts import make_evaluator

    tree, settings, problem = tree_in_domain(file, options)
    index, seeds = stage_index(settings, stage), fresh_worlds(seed)(worlds)
    with closing(make_evaluator(settings)) as evaluator:

        def outcomes(trees: Sequence[Node], places: Sequence[int]) -> list[list[Outcome]]:
            return evaluated(evaluator, trees, index, places)

        usages = with_losses(usage(problem.run(index), tree, seeds), tree, outcomes, seeds)
    if as_json:
        click.echo(json.dumps(nan_to_none([asdict(u) for u in usages]), indent=2))
    elif as_text:
        click.echo(with_subtrees(explained(tree, usages)), nl=False)
    else:
        _draw(tree, usages)
        if learned := _learned(tree, Path(file).parent):
            click.echo("\n".join(in_lines(learned)))


def _learned(tree: Node, folder: Path) -> list[str]:
    """What the run in a folder has found out about the actions of a tree; [] if there is none."""
    run = RunFolder(folder)
    if not run.finished():
        return []
    actions = names_in(tree)[0]
    learned = run.summary().get("learned", ())
    return [s for s in learned if re.split(r"\W", s, maxsplit=1)[0] in actions]


def _draw(tree: Node, usages: Sequence[NodeUsage]) -> None:
    """Draws the tree with the usage of each node."""
    from rich.text import Text

    from islandgp.bt.export.render import to_rich

    notes = [Text(with_counts(u), "dim" if u.worlds else "bold red") for u in usages]
    standard_output().print(to_rich(tree, notes))
