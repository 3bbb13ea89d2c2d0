"""`islandgp diff`: the differences between two trees."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import click

from islandgp.bt.analysis.compare import Mark, compare
from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.language import PlacedTree, SourceSpan, domain_of, parse_placed
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.bt.export.render import label
from islandgp.commands.files import FILE, TreeText, read_tree_text
from islandgp.commands.options import DomainOptions, with_vocabulary_options
from islandgp.commands.setting import vocabulary_of
from islandgp.errors import DomainError

COLOURS: Final = {Mark.DELETED: "red", Mark.INSERTED: "green", Mark.CHANGED: "yellow"}


@click.command()
@click.argument("old", type=FILE)
@click.argument("new", type=FILE)
@click.option("--all", "show_all", is_flag=True, help="Show the unchanged nodes as well.")
@with_vocabulary_options
def command(old: str, new: str, show_all: bool, options: DomainOptions) -> None:
    """Compare the trees in OLD and NEW, node by node.

    Marks: - deleted, + inserted, ~ changed; the number after # is the line in the file. Exit
    code 1 if the trees or their domains differ.
    """
    before, after = read_tree_text(old), read_tree_text(new)
    (a, places_a, _), (b, places_b, _) = _placed(before), _placed(after)
    domains = [name for file in (before, after) if (name := domain_of(file.text))]
    are_two_domains = len(set(domains)) > 1

    def read_vocabulary() -> Vocabulary:
        return vocabulary_of(after, options)

    if options.declaration is not None:
        read_vocabulary()  # a wrong declaration is reported first
    if are_two_domains:
        click.echo("They are for two domains: {} and {}.".format(*domains))
    if a == b:
        click.echo("The same nodes." if are_two_domains else "The same tree.")
        sys.exit(int(are_two_domains))
    click.echo("\n".join(_lines(a, b, (places_a, places_b), show_all)))
    if not are_two_domains and _do_the_same(a, b, read_vocabulary):
        click.echo("Written differently, but they do the same.")
    sys.exit(1)


def _placed(source: TreeText) -> PlacedTree:
    return parse_placed(source.text, name=source.name, folder=source.folder, named=False)


def _do_the_same(a: Node, b: Node, read_vocabulary: Callable[[], Vocabulary]) -> bool:
    """True if both trees have the same simplified form, with or without their vocabulary."""
    if simplify(a).tree == simplify(b).tree:
        return True
    try:
        vocabulary = read_vocabulary()
    except DomainError:  # the domain is not configured
        return False
    return simplify(a, vocabulary).tree == simplify(b, vocabulary).tree


def _lines(
    a: Node, b: Node, file_places: tuple[Sequence[SourceSpan], Sequence[SourceSpan]], show_all: bool
) -> Iterator[str]:
    lines = compare(a, b)
    for line in lines:
        if line.mark is Mark.SAME and not show_all:
            continue
        texts = dict.fromkeys(label(node) for node in (line.old, line.new) if node is not None)
        pairs = zip(file_places, (line.old_place, line.new_place), strict=True)
        at = dict.fromkeys(f"{places[at].line}" for places, at in pairs if at is not None)
        text = f"{line.mark} {'  ' * line.level}{' -> '.join(texts)}  # {' -> '.join(at)}"
        plain = bool(os.environ.get("NO_COLOR"))  # see no-color.org
        yield text if plain else click.style(text, fg=COLOURS.get(line.mark))
    counts = [sum(line.mark is mark for line in lines) for mark in COLOURS]
    yield "{} deleted, {} inserted, {} changed".format(*counts)
