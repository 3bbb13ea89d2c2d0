"""`islandgp export`: converts a tree to the format of another tool."""

from __future__ import annotations

from typing import Final

import click

from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.json import to_json
from islandgp.bt.export.plan import SemanticDifference
from islandgp.commands.files import FILE, STDIN, check_other_file, write_text
from islandgp.commands.options import (
    DomainOptions,
    NumberRange,
    with_output_option,
    with_vocabulary_options,
)
from islandgp.commands.setting import read_in_domain

STEPS: Final = (1e-6, 86_400)
"""Fewest and most seconds between two ticks."""
FORMATS: Final = ("json", "btcpp", "pytrees")
_BY_ENDING: Final = {"json": "json", "xml": "btcpp", "py": "pytrees"}


@click.command()
@click.argument("file", type=FILE, required=False)
@click.option("--to", "form", type=click.Choice(FORMATS), help="Default: by the ending of -o.")
@with_output_option
@click.option("--plain", is_flag=True, help="Only nodes of the library; the meaning may differ.")
@click.option("--header", is_flag=True, help="Write the C++ header with our nodes; no FILE.")
@click.option(
    "--step",
    type=NumberRange(*STEPS),
    help="Seconds between two ticks; needed for trees with waits, timeouts or cooldowns.",
)
@with_vocabulary_options
def command(
    file: str | None,
    form: str | None,
    output: str,
    plain: bool,
    step: float | None,
    header: bool,
    options: DomainOptions,
) -> None:
    """Write the tree in FILE for another tool.

    json: for your own programs; --plain and --step have no effect. btcpp: XML for
    BehaviorTree.CPP 4; where a node of the library has another meaning, a node of
    --header replaces it. pytrees: a Python module that builds a py_trees tree. With
    --plain, differences in meaning are printed on the standard error, and explained in
    docs/exports.md.
    """
    if header:
        if file is not None or form is not None or plain or step is not None:
            raise click.UsageError(
                "expected --header alone or with -o, found FILE, --to, --plain or --step with it"
            )
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
    exported, losses = _export(tree, form, vocabulary, plain, step)
    write_text(output, exported)
    if options.declaration is not None:
        from islandgp.bt.export.declared import words_as_keys

        for word in words_as_keys(tree, vocabulary):
            click.echo(
                f"{word} is taken as a key of the blackboard, as {options.declaration} declares no"
                " words of keys; if it is a word, declare it in a vocabulary in JSON",
                err=True,
            )
    for loss in losses:
        click.echo(f"not the same ({loss.about}): {loss.message}", err=True)
    if form == "btcpp" and not plain and behaviortree_cpp.needs_header(tree):
        click.echo(
            f"needs {behaviortree_cpp.HEADER}, which `islandgp export --header -o"
            f" {behaviortree_cpp.HEADER}` writes; --plain avoids it",
            err=True,
        )


def _export(
    tree: Node, form: str, vocabulary: Vocabulary, plain: bool, step: float | None
) -> tuple[str, list[SemanticDifference]]:
    if form == "json":
        return to_json(tree), []
    other = behaviortree_cpp if form == "btcpp" else py_trees
    write = behaviortree_cpp.to_xml if form == "btcpp" else py_trees.to_python
    text = write(tree, vocabulary, plain=plain, step_s=step)
    return text, other.losses(tree) if plain else []
