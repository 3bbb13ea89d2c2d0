"""`islandgp export`: converts a tree to the format of another tool."""

from __future__ import annotations

from typing import Final

import click

from islandgp.bt.export import behaviortree_cpp
from islandgp.bt.export.json import to_json
from islandgp.bt.export.py_trees import to_python
from islandgp.commands.files import FILE, STDIN, check_other_file, write_text
from islandgp.commands.options import DomainOptions, with_output_option, with_vocabulary_options
from islandgp.commands.setting import read_in_domain

FORMATS: Final = ("json", "btcpp", "pytrees")
_BY_ENDING: Final = {"json": "json", "xml": "btcpp", "py": "pytrees"}


@click.command()
@click.argument("file", type=FILE, required=False)
@click.option("--to", "form", type=click.Choice(FORMATS), help="Default: by the ending of -o.")
@with_output_option
@click.option("--header", is_flag=True, help="Write the C++ header with our nodes; no FILE.")
@with_vocabulary_options
def command(
    file: str | None,
    form: str | None,
    output: str,
    header: bool,
    options: DomainOptions,
) -> None:
    """Write the tree in FILE for another tool.

    json: for your own programs. btcpp: XML for BehaviorTree.CPP 4; where a node of the
    library has another meaning, a node of --header replaces it. pytrees: a Python module
    that builds a py_trees tree. docs/exports.md describes the formats.
    """
    if header:
        if file is not None or form is not None:
            raise click.UsageError("expected --header alone or with -o, found FILE or --to with it")
        write_text(output, behaviortree_cpp.header())
        return
    if file is None:
        raise click.UsageError("expected FILE, found none")
    check_other_file(file, output)
    form = form or _BY_ENDING.get(output.rpartition(".")[2].lower(), "")
    if not form:
        endings = ", ".join(f".{ending}" for ending in _BY_ENDING)
        raise click.UsageError(
            f"expected --to with one of {', '.join(FORMATS)}, or a name after -o that ends in one"
            f" of {endings}, found {'none' if output == STDIN else output}"
        )
    _, vocabulary, tree = read_in_domain(file, options, marked=True)
    if form == "json":
        text = to_json(tree)
    else:
        text = (behaviortree_cpp.to_xml if form == "btcpp" else to_python)(tree, vocabulary)
    write_text(output, text)
    for each in behaviortree_cpp.needs(text) if form == "btcpp" else ():
        click.echo(f"needs {each}", err=True)
