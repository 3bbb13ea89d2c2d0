"""`islandgp simplify`: shortens a tree without changing its behaviour."""

from __future__ import annotations

from collections import Counter

import click

from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.language import domain_of, to_text
from islandgp.bt.core.node import size
from islandgp.commands.files import FILE, check_other_file, write_text
from islandgp.commands.options import DomainOptions, with_output_option, with_vocabulary_options
from islandgp.commands.setting import read_in_domain


@click.command()
@click.argument("file", type=FILE)
@with_output_option
@click.option("--explain", is_flag=True, help="Print each change with its reason to stderr.")
@with_vocabulary_options
def command(file: str, output: str, explain: bool, options: DomainOptions) -> None:
    """Shorten the tree in FILE without changing its behaviour.

    The result is printed with every `use` expanded and without comments.
    """
    check_other_file(file, output)
    text, vocabulary, tree = read_in_domain(file, options)
    shorter, reasons = simplify(tree, vocabulary)
    domain = domain_of(text)
    write_text(output, (f"domain {domain}\n\n" if domain else "") + to_text(shorter))
    if explain:
        for reason, times in Counter(reasons).items():
            click.echo(f"{reason}{f' ({times} times)' if times > 1 else ''}", err=True)
        changes = f"{len(reasons) or 'no'} change{'s' * (len(reasons) != 1)}"
        click.echo(f"{size(tree)} nodes before, {size(shorter)} after; {changes}", err=True)
