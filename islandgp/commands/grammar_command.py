"""`islandgp grammar`: prints the language of a domain for constrained decoding."""

from __future__ import annotations

from dataclasses import replace

import click

from islandgp.bt.export.grammar import FORMATS, tree_grammar
from islandgp.commands.files import TreeText, write_text
from islandgp.commands.options import DomainOptions, with_output_option, with_vocabulary_options
from islandgp.commands.setting import vocabulary_of

DEPTH = 8  # levels of a tree, as section 2.2.3 limits them


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
def command(
    domain: str | None, notation: str, depth: int, output: str, options: DomainOptions
) -> None:
    """Print the grammar of the trees of a domain, for a language model's decoder.

    Each text of the grammar is a tree that `islandgp check` accepts in this domain.
    """
    if domain is not None:
        options = replace(options, overrides=(*options.overrides, f"domain={domain}"))
    vocabulary = vocabulary_of(TreeText("", "<grammar>", None), options)
    write_text(output, tree_grammar(vocabulary, depth).text(notation))
