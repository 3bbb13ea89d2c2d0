"""`islandgp simplify`: a shorter tree that does the same."""

from __future__ import annotations

from collections import Counter

import click

from islandgp.bt.language import to_text
from islandgp.bt.node import size
from islandgp.bt.simplify import simplify
from islandgp.commands.files import FILE, OUTPUT, STDIN, read_tree, write_text


@click.command()
@click.argument("file", type=FILE)
@click.option("-o", "--output", type=OUTPUT, default=STDIN, help="File to write.")
@click.option("--explain", is_flag=True, help="Tell on the standard error what was done and why.")
def command(file: str, output: str, explain: bool) -> None:
    """Shorten the tree in FILE without changing what it does.

    The result is printed with every `use` expanded and without comments.
    """
    tree = read_tree(file)
    shorter, reasons = simplify(tree)
    write_text(output, to_text(shorter))
    if explain:
        for reason, times in Counter(reasons).items():
            click.echo(f"{reason}{f' ({times} times)' if times > 1 else ''}", err=True)
        click.echo(f"{size(tree)} nodes before, {size(shorter)} after", err=True)
