"""`islandgp examples`: the example trees that come with the package."""

from __future__ import annotations

import shutil
from itertools import takewhile

import click

from islandgp.errors import ConfigError
from islandgp.resources import resource


@click.command()
@click.argument("name", required=False)
def command(name: str | None) -> None:
    """List the example trees, or print the one called NAME.

    `islandgp examples all_rounder > mine.bt` makes a copy to edit.
    """
    files = {file.stem: file for file in sorted(resource("grammar").glob("examples/*.bt"))}
    if name is None:
        formatter = click.HelpFormatter(width=shutil.get_terminal_size().columns)
        formatter.write_dl([(s, _about(f.read_text(encoding="utf-8"))) for s, f in files.items()])
        click.echo(formatter.getvalue())
        click.echo("islandgp examples NAME prints one.", err=True)
        return
    if name.removesuffix(".bt") not in files:
        raise ConfigError(
            f"Expected the name of an example, found {name}; there are {', '.join(files)}."
        )
    click.echo(files[name.removesuffix(".bt")].read_text(encoding="utf-8"), nl=False)


def _about(text: str) -> str:
    """The first lines of a tree's comment, before the line with its size."""
    comments = (line.lstrip("#").strip() for line in text.splitlines() if line.startswith("#"))
    return " ".join(takewhile(lambda line: " nodes, depth " not in line, comments))
