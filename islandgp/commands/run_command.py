"""`islandgp run`: the Hydra entry under the name of a subcommand."""

from __future__ import annotations

import sys

import click
from click.shell_completion import CompletionItem

from islandgp.running.app import main


def _complete(ctx: click.Context, _: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from islandgp.commands.completion_command import overrides

    return overrides(ctx.params.get("overrides") or (), incomplete)


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": []},
    add_help_option=False,
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED, shell_complete=_complete)
def command(overrides: tuple[str, ...]) -> None:
    """The same as `python -m islandgp OVERRIDES...`."""
    sys.exit(main(overrides))
