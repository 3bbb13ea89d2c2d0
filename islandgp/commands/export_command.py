"""`islandgp export`: a tree in the form of another tool."""

from __future__ import annotations

from typing import Final

import click

from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.json import to_json
from islandgp.bt.export.plan import Loss
from islandgp.bt.language import parse
from islandgp.bt.node import Node
from islandgp.bt.vocabulary import Vocabulary
from islandgp.commands.files import FILE, OUTPUT, STDIN, called, read_text, write_text
from islandgp.commands.setting import vocabulary_of, with_domain_options

FORMATS: Final = ("json", "btcpp", "pytrees")
_BY_ENDING: Final = {"json": "json", "xml": "btcpp", "py": "pytrees"}


@click.command()
@click.argument("file", type=FILE)
@click.option("--to", "form", type=click.Choice(FORMATS), help="Default: by the ending of -o.")
@click.option("-o", "--output", type=OUTPUT, default=STDIN, help="File to write.")
@with_domain_options
def command(
    file: str,
    form: str | None,
    output: str,
    overrides: tuple[str, ...],
    config_dir: str | None,
) -> None:
    """Write the tree in FILE for another tool.

    json: without loss, for your own programs. btcpp: XML for BehaviorTree.CPP 4.
    pytrees: a Python module that builds a py_trees tree. What does not mean the
    same there is told on the standard error, and explained in docs/exports.md.
    """
    form = form or _BY_ENDING.get(output.rpartition(".")[2], "")
    if not form:
        raise click.UsageError(f"Missing option '--to', one of {', '.join(FORMATS)}.")
    text, name = read_text(file), called(file)
    vocabulary = vocabulary_of(text, overrides, config_dir, name=name)
    exported, losses = _export(parse(text, vocabulary, name=name), form, vocabulary)
    write_text(output, exported)
    for loss in losses:
        click.echo(f"not the same ({loss.about}): {loss.message}", err=True)


def _export(tree: Node, form: str, vocabulary: Vocabulary) -> tuple[str, list[Loss]]:
    if form == "json":
        return to_json(tree), []
    if form == "btcpp":
        return behaviortree_cpp.to_xml(tree, vocabulary), behaviortree_cpp.losses(tree)
    return py_trees.to_python(tree, vocabulary), py_trees.losses(tree)
