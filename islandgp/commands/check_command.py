"""`islandgp check`: errors and doubtful places in tree files."""

from __future__ import annotations

import sys

import click

from islandgp.bt.language import parse
from islandgp.bt.limits import Limits, check_limits
from islandgp.bt.lint import warnings
from islandgp.bt.node import depth, size
from islandgp.commands.files import FILE, called, folder_of, read_text
from islandgp.commands.setting import vocabulary_of, with_domain_options
from islandgp.errors import TreeError


@click.command()
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("--strict", is_flag=True, help="Exit code 1 for warnings as well.")
@click.option("--max-depth", type=click.IntRange(1), help="Most levels; default: any.")
@click.option("--max-nodes", type=click.IntRange(1), help="Most nodes; default: any.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing about files that are right.")
@with_domain_options
def command(
    files: tuple[str, ...],
    strict: bool,
    max_depth: int | None,
    max_nodes: int | None,
    quiet: bool,
    overrides: tuple[str, ...],
    config_dir: str | None,
) -> None:
    """Look for errors and doubtful places in FILES.

    A `use` counts as large as its subtree. Exit code 1 when a file is not a tree.
    """
    limits = Limits(max_depth or 10**9, max_nodes or 10**9)
    wrong = doubtful = 0
    for file in files:
        text, name = read_text(file), called(file)
        vocabulary = vocabulary_of(text, overrides, config_dir, name=name)
        try:
            tree = parse(text, vocabulary, name=name, folder=folder_of(file))
            check_limits(tree, limits)
        except TreeError as error:
            message = str(error)
            click.echo(message if message.startswith(name) else f"{name}: {message}")
            wrong += 1
            continue
        found = warnings(text, vocabulary, name=name, folder=folder_of(file))
        for finding in found:
            click.echo(finding.text(text, name=name))
        doubtful += bool(found)
        if not quiet:
            how = f"{len(found)} warning{'s' * (len(found) != 1)}" if found else "no warnings"
            click.echo(f"{name}: {size(tree)} nodes, depth {depth(tree)}, {how}")
    sys.exit(1 if wrong or (strict and doubtful) else 0)
