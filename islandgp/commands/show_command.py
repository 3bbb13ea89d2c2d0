"""`islandgp show`: draws a tree."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import click

from islandgp.bt.core.node import Node
from islandgp.bt.export.render import to_dot, to_lines, to_mermaid, to_rich, to_svg
from islandgp.commands.files import FILE, STDIN, check_other_file, read_tree_text, write_text
from islandgp.commands.options import with_output_option

FORMATS: Final[dict[str, Callable[[Node], str]]] = {
    "text": lambda tree: "\n".join(to_lines(tree)) + "\n",
    "svg": to_svg,
    "mermaid": to_mermaid,
    "dot": to_dot,
}


ENDINGS: Final = {
    "": "text",
    ".txt": "text",
    ".svg": "svg",
    ".mmd": "mermaid",
    ".mermaid": "mermaid",
    ".dot": "dot",
    ".gv": "dot",
}
"""The format by the extension of a file."""


@click.command()
@click.argument("file", type=FILE)
@click.option("--format", "form", type=click.Choice([*FORMATS]), help="Default: by -o, else text.")
@with_output_option
def command(file: str, form: str | None, output: str) -> None:
    """Draw the tree in FILE: in the terminal, as SVG, Mermaid or Graphviz dot.

    Named subtrees are drawn where they are used.
    """
    check_other_file(file, output)
    form = form or _form(output)
    tree = read_tree_text(file).tree()
    if form == "text" and output == STDIN:
        from rich.console import Console

        Console(soft_wrap=True, highlight=False).print(to_rich(tree))
        return
    write_text(output, FORMATS[form](tree))


def _form(output: str) -> str:
    """The format that a file's name asks for. Raises UsageError."""
    ending = Path(output).suffix.lower()
    if ending not in ENDINGS:
        endings = ", ".join(filter(None, ENDINGS))
        raise click.UsageError(
            f"-o {output}: expected a name that ends in one of {endings}, found {ending};"
            " rename it or give --format."
        )
    return ENDINGS[ending]
