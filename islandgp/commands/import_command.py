"""`islandgp import`: converts a tree of another tool to the language."""

from __future__ import annotations

import click

from islandgp.bt.analysis.lint import REFUSED, warnings
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import to_text
from islandgp.bt.export.cpp_importer import DIFFERENCES
from islandgp.bt.export.declared import UNNAMED
from islandgp.bt.export.import_cpp import Imported, read_tree
from islandgp.bt.export.json import from_json
from islandgp.commands.files import FILE, TreeText, check_other_file, read_tree_text, write_text
from islandgp.commands.options import DomainOptions, with_output_option, with_vocabulary_options
from islandgp.commands.setting import default_domain, vocabulary_of
from islandgp.errors import TreeError


@click.command()
@click.argument("file", type=FILE)
@click.option("--tree", "identity", help="ID of a tree; default: the main tree.")
@click.option("--strict", is_flag=True, help="Reject nodes whose meaning would change.")
@with_output_option
@with_vocabulary_options
def command(
    file: str,
    identity: str | None,
    strict: bool,
    output: str,
    options: DomainOptions,
) -> None:
    """Turn JSON or BehaviorTree.CPP XML in FILE into a tree of the language.

    A node that the language does not have is an error with its place. Differences in
    behaviour are printed to the standard error. The result names its domain, unless
    that is the default domain.
    """
    check_other_file(file, output)
    text, name, folder = read_tree_text(file)
    start = text.lstrip("\ufeff \t\r\n")[:1]
    wanted = "BehaviorTree.CPP XML with --tree" if identity else "JSON or BehaviorTree.CPP XML"
    if not start or start not in ("<" if identity else "<{["):
        raise TreeError(
            f"{name}: expected {wanted}, found another format; a tree in the language needs no"
            " import"
        )
    source = TreeText(text if options.declaration else "", name, None)
    vocabulary = vocabulary_of(source, options)
    if start != "<":
        tree = from_json(text, vocabulary, name=name)
        imported = Imported(tree, (), to_text(tree))
    else:
        imported = read_tree(text, vocabulary, name=name, tree=identity, folder=folder)
    losses = [
        f"{name}:{line}:{column}: not the same ({about}): there, {DIFFERENCES[about]}"
        for line, column, about in imported.differences
    ]
    if strict and losses:
        raise TreeError(
            "\n".join([*losses, "Nothing is written; leave out --strict to accept it."])
        )
    named = vocabulary.domain not in (default_domain(), UNNAMED)
    write_text(
        output, (f"domain {vocabulary.domain}\n\n" if named else "") + format_text(imported.text)
    )
    lint = warnings(imported.text, vocabulary, name=name)
    shared = [f"{name}: warning: {each.message}" for each in lint if each.code in REFUSED]
    for line in (*losses, *shared):
        click.echo(line, err=True)
