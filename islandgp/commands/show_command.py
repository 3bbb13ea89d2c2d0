"""`islandgp show`: draws a tree."""

from __future__ import annotations

from pathlib import Path

import click

from islandgp.bt.export.render import to_rich, to_svg
from islandgp.commands.files import FILE, STDIN, check_other_file, read_tree_text, write_text
from islandgp.commands.options import with_output_option


@click.command()
@click.argument("file", type=FILE)
@with_output_option
def command(file: str, output: str) -> None:
    """Draw the tree in FILE: in the terminal, as text, or as SVG with -o NAME.svg.

    Named subtrees are drawn where they are used.
    """
    check_other_file(file, output)
    ending = Path(output).suffix.lower()
    if ending not in ("", ".txt", ".svg"):
        raise click.UsageError(
            f"-o {output}: expected a name that ends in .svg or .txt, found {ending}; rename it"
        )
    tree = read_tree_text(file).tree()
    if output == STDIN:
        from rich.console import Console

        Console(soft_wrap=True, highlight=False).print(to_rich(tree))
        return
    write_text(output, to_svg(tree) if ending == ".svg" else f"{to_rich(tree)}\n")
