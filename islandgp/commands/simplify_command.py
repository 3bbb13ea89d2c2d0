"""`islandgp simplify`: a shorter tree that does the same."""

from __future__ import annotations

from collections import Counter

import click

from islandgp.bt.language import domain_of, parse, to_text
from islandgp.bt.node import size
from islandgp.bt.simplify import simplify
from islandgp.commands.files import FILE, OUTPUT, STDIN, called, folder_of, read_text, write_text
from islandgp.commands.setting import vocabulary_of, with_domain_options, with_vocabulary_option


@click.command()
@click.argument("file", type=FILE)
@click.option("-o", "--output", type=OUTPUT, default=STDIN, help="File to write.")
@click.option("--explain", is_flag=True, help="Tell on the standard error what was done and why.")
@with_domain_options
@with_vocabulary_option
def command(
    file: str,
    output: str,
    explain: bool,
    overrides: tuple[str, ...],
    config_dir: str | None,
    declaration: str | None,
) -> None:
    """Shorten the tree in FILE without changing what it does.

    The result is printed with every `use` expanded and without comments.
    """
    text, name = read_text(file), called(file)
    vocabulary = vocabulary_of(
        text, overrides, config_dir, name=name, declaration=declaration, folder=folder_of(file)
    )
    tree = parse(text, vocabulary, name=name, folder=folder_of(file))
    shorter, reasons = simplify(tree, vocabulary)
    domain = domain_of(text)
    write_text(output, (f"domain {domain}\n\n" if domain else "") + to_text(shorter))
    if explain:
        for reason, times in Counter(reasons).items():
            click.echo(f"{reason}{f' ({times} times)' if times > 1 else ''}", err=True)
        click.echo(f"{size(tree)} nodes before, {size(shorter)} after", err=True)
