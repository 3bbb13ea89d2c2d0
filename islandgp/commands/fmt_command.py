"""`islandgp fmt`: formats tree files; comments and named subtrees are kept."""

from __future__ import annotations

import difflib
import sys

import click

from islandgp.bt.core.format import format_text
from islandgp.commands.files import FILE, STDIN, read_tree_text, write_text
from islandgp.errors import IslandError


@click.command()
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("--check", is_flag=True, help="Write nothing; exit code 1 if a file would change.")
@click.option("--diff", is_flag=True, help="Write nothing; show what would change.")
def command(files: tuple[str, ...], check: bool, diff: bool) -> None:
    """Format the trees in FILES.

    Comments and named subtrees are kept. `-` reads the standard input and prints
    the result. A file that is not a tree is reported and not changed; exit code 2.
    """
    changed = 0
    wrong: list[str] = []
    for file in files:
        try:
            before, name, folder = read_tree_text(file)
            after = format_text(before, name=name, folder=folder)
        except IslandError as error:
            wrong.append(str(error))
            continue
        if diff:
            lines = difflib.unified_diff(
                before.splitlines(), after.splitlines(), name, f"{name} (formatted)", lineterm=""
            )
            for line in lines:
                click.echo(line)
        elif file == STDIN and not check:
            write_text(file, after)
        elif before != after:
            if not check:
                write_text(file, after)
            click.echo(f"{'would change' if check else 'changed'} {name}", err=True)
        changed += before != after
    if wrong:
        raise IslandError("\n".join(wrong))
    sys.exit(1 if check and changed else 0)
