"""`islandgp replay`: an episode as a page to watch in a browser."""

from __future__ import annotations

from pathlib import Path

import click

from islandgp.commands.files import FILE, OUTPUT, STDIN, called, write_text
from islandgp.commands.setting import (
    Chosen,
    stage_index,
    tree_in_domain,
    with_domain_options,
    with_stage_option,
    with_timeout_option,
)


@click.command()
@click.argument("file", type=FILE)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the world; default: 0.")
@click.option("-o", "--output", type=OUTPUT, default="replay.html", show_default=True)
@click.option("--title", help="Default: the file's name.")
@with_domain_options
@with_stage_option
@with_timeout_option
def command(
    file: str,
    seed: int,
    output: str,
    title: str | None,
    chosen: Chosen,
    stage: int | None,
    timeout: float,
) -> None:
    """Run the tree in FILE in one world, and write a page that shows it.

    The page is self-contained: open it in a browser, send it by mail, or view it
    as an artifact in MLflow.
    """
    from islandgp.viewer.page import page
    from islandgp.viewer.recording import record

    tree, settings, problem = tree_in_domain(file, chosen)
    index = stage_index(settings, stage)
    recording = record(tree, problem, seed=seed, stage=index, limit=timeout)
    text = page(recording, title=title or Path(called(file)).stem)
    write_text(output, text)
    if output != STDIN:
        click.echo(f"{output}: {len(text.encode()) / 1000:.0f} kB", err=True)
