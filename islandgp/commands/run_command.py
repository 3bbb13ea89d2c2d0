"""`islandgp run`: the Hydra entry under the name of a subcommand."""

from __future__ import annotations

import sys

import click

from islandgp.running.app import main


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": []},
    add_help_option=False,
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def command(overrides: tuple[str, ...]) -> None:
    """The same as `python -m islandgp OVERRIDES...`."""
    sys.exit(main(overrides))
