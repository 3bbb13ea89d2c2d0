"""`islandgp import`: a tree of another tool in our language."""

from __future__ import annotations

import click

from islandgp.bt.export.import_cpp import from_xml
from islandgp.bt.export.json import from_json
from islandgp.bt.language import to_text
from islandgp.commands.files import FILE, OUTPUT, STDIN, called, read_text, write_text


@click.command()
@click.argument("file", type=FILE)
@click.option("--from", "form", type=click.Choice(["json", "btcpp"]), help="Default: by content.")
@click.option("-o", "--output", type=OUTPUT, default=STDIN, help="File to write.")
def command(file: str, form: str | None, output: str) -> None:
    """Turn JSON or BehaviorTree.CPP XML in FILE into a tree of the language.

    A node that the language does not have is refused, with its place.
    """
    text, name = read_text(file), called(file)
    form = form or ("btcpp" if text.lstrip("\ufeff \t\r\n").startswith("<") else "json")
    tree = (from_xml if form == "btcpp" else from_json)(text, name=name)
    write_text(output, to_text(tree))
