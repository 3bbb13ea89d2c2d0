"""Commands that read and write trees, and run none."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Final

import click

from islandgp.bt.analysis.compare import Mark, compare
from islandgp.bt.analysis.lint import REFUSED, warnings
from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import SourceSpan, domain_of, parse_placed, to_text
from islandgp.bt.core.node import Node, size
from islandgp.bt.export import behaviortree_cpp
from islandgp.bt.export.cpp_importer import DIFFERENCES
from islandgp.bt.export.declared import UNNAMED
from islandgp.bt.export.grammar import FORMATS, tree_grammar
from islandgp.bt.export.import_cpp import Imported, read_tree
from islandgp.bt.export.json import from_json, to_json
from islandgp.bt.export.py_trees import to_python
from islandgp.bt.export.render import label, to_rich, to_svg
from islandgp.commands.files import (
    FILE,
    STDIN,
    TreeText,
    check_other_file,
    read_tree_text,
    write_text,
)
from islandgp.commands.options import DomainOptions, with_output_option, with_vocabulary_options
from islandgp.commands.setting import default_domain, read_in_domain, vocabulary_of
from islandgp.commands.tables import print_table, standard_output
from islandgp.errors import ConfigError, IslandError, TreeError
from islandgp.resources import resource
from islandgp.text import in_its_domain

COLOURS: Final = {Mark.DELETED: "red", Mark.INSERTED: "green", Mark.CHANGED: "yellow"}

FORMATS_BY_ENDING: Final = {"json": "json", "xml": "btcpp", "py": "pytrees"}

DEPTH: Final = 8  # levels of a tree, as section 2.2.3 limits them


@click.command()
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("--check", is_flag=True, help="Write nothing; exit code 1 if a file would change.")
def fmt_command(files: tuple[str, ...], check: bool) -> None:
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
        if file == STDIN and not check:
            write_text(file, after)
        elif before != after:
            if check:
                click.echo(f"would change {name}", err=True)
            else:
                write_text(file, after)
        changed += before != after
    if wrong:
        raise IslandError("\n".join(wrong))
    sys.exit(1 if check and changed else 0)


@click.command()
@click.argument("file", type=FILE)
@with_output_option
def show_command(file: str, output: str) -> None:
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
        standard_output().print(to_rich(tree))
        return
    write_text(output, to_svg(tree) if ending == ".svg" else f"{to_rich(tree)}\n")


@click.command()
@click.argument("file", type=FILE)
@with_output_option
@click.option("--explain", is_flag=True, help="Print each change with its reason to stderr.")
@with_vocabulary_options
def simplify_command(file: str, output: str, explain: bool, options: DomainOptions) -> None:
    """Shorten the tree in FILE without changing its behaviour.

    The result is printed with every `use` expanded and without comments.
    """
    check_other_file(file, output)
    text, vocabulary, tree = read_in_domain(file, options)
    shorter, reasons = simplify(tree, vocabulary)
    write_text(output, in_its_domain(domain_of(text), to_text(shorter)))
    if explain:
        for reason, times in Counter(reasons).items():
            click.echo(f"{reason}{f' ({times} times)' if times > 1 else ''}", err=True)
        changes = f"{len(reasons) or 'no'} change{'s' * (len(reasons) != 1)}"
        click.echo(f"{size(tree)} nodes before, {size(shorter)} after; {changes}", err=True)


@click.command()
@click.argument("old", type=FILE)
@click.argument("new", type=FILE)
def diff_command(old: str, new: str) -> None:
    """Compare the trees in OLD and NEW, node by node.

    Marks: - deleted, + inserted, ~ changed; the number after # is the line in the file. Exit
    code 1 if the trees or their domains differ.
    """
    before, after = read_tree_text(old), read_tree_text(new)
    (a, places_a, _), (b, places_b, _) = (
        parse_placed(each.text, name=each.name, folder=each.folder, named=False)
        for each in (before, after)
    )
    domains = {name: None for file in (before, after) if (name := domain_of(file.text))}
    if are_for_two := len(domains) > 1:
        click.echo("They are for two domains: {} and {}.".format(*domains))
    if a == b:
        click.echo("The same nodes." if are_for_two else "The same tree.")
        sys.exit(int(are_for_two))
    click.echo("\n".join(_marked(a, b, (places_a, places_b))))
    sys.exit(1)


def _marked(
    a: Node, b: Node, file_places: tuple[Sequence[SourceSpan], Sequence[SourceSpan]]
) -> Iterator[str]:
    """A line for each node that differs, and one with their numbers."""
    lines = compare(a, b)
    for line in lines:
        if line.mark is Mark.SAME:
            continue
        texts = dict.fromkeys(label(node) for node in (line.old, line.new) if node is not None)
        pairs = zip(file_places, (line.old_place, line.new_place), strict=True)
        at = dict.fromkeys(f"{places[at].line}" for places, at in pairs if at is not None)
        text = f"{line.mark} {'  ' * line.level}{' -> '.join(texts)}  # {' -> '.join(at)}"
        plain = bool(os.environ.get("NO_COLOR"))  # see no-color.org
        yield text if plain else click.style(text, fg=COLOURS[line.mark])
    counts = [sum(line.mark is mark for line in lines) for mark in COLOURS]
    yield "{} deleted, {} inserted, {} changed".format(*counts)


@click.command()
@click.argument("file", type=FILE, required=False)
@click.option(
    "--to",
    "form",
    type=click.Choice([*FORMATS_BY_ENDING.values()]),
    help="Default: by the ending of -o.",
)
@with_output_option
@click.option("--header", is_flag=True, help="Write the C++ header with our nodes; no FILE.")
@with_vocabulary_options
def export_command(
    file: str | None, form: str | None, output: str, header: bool, options: DomainOptions
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
    form = form or FORMATS_BY_ENDING.get(output.rpartition(".")[2].lower(), "")
    if not form:
        endings = ", ".join(f".{ending}" for ending in FORMATS_BY_ENDING)
        raise click.UsageError(
            f"expected --to with one of {', '.join(FORMATS_BY_ENDING.values())}, or a name after -o"
            f" that ends in one of {endings}, found {'none' if output == STDIN else output}"
        )
    _, vocabulary, tree = read_in_domain(file, options, marked=True)
    writer = {"btcpp": behaviortree_cpp.to_xml, "pytrees": to_python}.get(form)
    text = writer(tree, vocabulary) if writer else to_json(tree)
    write_text(output, text)
    for each in behaviortree_cpp.needs(text) if form == "btcpp" else ():
        click.echo(f"needs {each}", err=True)


@click.command()
@click.argument("file", type=FILE)
@click.option("--tree", "identity", help="ID of a tree; default: the main tree.")
@click.option("--strict", is_flag=True, help="Reject nodes whose meaning would change.")
@with_output_option
@with_vocabulary_options
def import_command(
    file: str, identity: str | None, strict: bool, output: str, options: DomainOptions
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
    vocabulary = vocabulary_of(TreeText(text if options.declaration else "", name, folder), options)
    try:
        if start == "<":
            imported = read_tree(text, vocabulary, name=name, tree=identity, folder=folder)
        else:
            tree = from_json(text, vocabulary, name=name)
            imported = Imported(tree, {}, to_text(tree))
    except TreeError as error:
        if options.overrides or options.declaration or vocabulary.domain != default_domain():
            raise
        raise TreeError(
            f"{error}\nThe file does not say its domain and was read as one of"
            f" {vocabulary.domain}; for another, give --set domain=NAME or --vocabulary FILE."
        ) from None
    losses = [
        f"{name}:{line}:{column}: not the same ({about}): there, {DIFFERENCES[about]}"
        for about, (line, column) in imported.differences.items()
    ]
    if strict and losses:
        raise TreeError(
            "\n".join([*losses, "Nothing is written; leave out --strict to accept it."])
        )
    named = vocabulary.domain not in (default_domain(), UNNAMED)
    write_text(output, in_its_domain(vocabulary.domain * named, format_text(imported.text)))
    lint = warnings(imported.text, vocabulary, name=name)
    shared = [f"{name}: warning: {each.message}" for each in lint if each.code in REFUSED]
    for line in (*losses, *shared):
        click.echo(line, err=True)


@click.command()
@click.option("--domain", metavar="NAME", help="The same as --set domain=NAME.")
@click.option(
    "--format",
    "notation",
    type=click.Choice(FORMATS),
    default=FORMATS[0],
    help="lark: llguidance, vLLM, SGLang; gbnf: llama.cpp.",
)
@click.option("--depth", type=click.IntRange(1, 40), default=DEPTH, help="Most levels of a tree.")
@with_output_option
@with_vocabulary_options
def grammar_command(
    domain: str | None, notation: str, depth: int, output: str, options: DomainOptions
) -> None:
    """Print the grammar of the trees of a domain, for a language model's decoder.

    Each text of the grammar is a tree that `islandgp check` accepts in this domain.
    """
    if domain is not None:
        options = replace(options, overrides=(*options.overrides, f"domain={domain}"))
    vocabulary = vocabulary_of(TreeText("", "<grammar>", None), options)
    write_text(output, tree_grammar(vocabulary, depth).text(notation))


@click.command()
@click.argument("name", required=False)
def examples_command(name: str | None) -> None:
    """List the example trees, or print the one called NAME.

    `islandgp examples all_rounder > mine.bt` makes a copy to edit.
    """
    files = {file.stem: file for file in sorted(resource("grammar").glob("examples/*.bt"))}
    texts = {name: file.read_text(encoding="utf-8") for name, file in files.items()}
    if name is None:
        print_table(standard_output(), [("tree", [*texts]), ("", [*map(_about, texts.values())])])
        click.echo("islandgp examples NAME prints one.", err=True)
        return
    if name.removesuffix(".bt") not in texts:
        raise ConfigError(
            f"Expected the name of an example, found {name}; there are {', '.join(texts)}."
        )
    click.echo(texts[name.removesuffix(".bt")], nl=False)


def _about(text: str) -> str:
    """The first lines of a tree's comment, before the line with its size."""
    comments = (line.lstrip("#").strip() for line in text.splitlines() if line.startswith("#"))
    return " ".join(takewhile(lambda line: " nodes, depth " not in line, comments))
