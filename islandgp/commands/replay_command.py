"""`islandgp replay`: writes an episode as a page for a browser."""

from __future__ import annotations

from pathlib import Path

import click

from islandgp.commands.files import FILE, OUTPUT, STDIN, check_other_file, display_name, write_text
from islandgp.commands.options import EpisodeOptions, with_episode_options
from islandgp.commands.setting import recorded


@click.command()
@click.argument("file", type=FILE)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the world.")
@click.option("-o", "--output", type=OUTPUT, default="replay.html")
@click.option("--title", help="Default: the file's name.")
@with_episode_options
def command(file: str, seed: int, output: str, title: str | None, episode: EpisodeOptions) -> None:
    """Run the tree in FILE in one world, and write a page that shows it.

    The page is self-contained: open it in a browser, send it by mail, or view it
    as an artifact in MLflow.
    """
    from islandgp.viewer.page import page

    check_other_file(file, output)
    text = page(recorded(file, seed, episode), title=title or Path(display_name(file)).stem)
    write_text(output, text)
    if output != STDIN:
        click.echo(f"{output}: {len(text.encode()) / 1000:.0f} kB", err=True)
