"""`islandgp diff`: what changed between two trees."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterator
from typing import Final

import click

from islandgp.bt.compare import MOST_NODES, Mark, compare
from islandgp.bt.language import to_text
from islandgp.bt.node import Node, size
from islandgp.bt.render.label import label
from islandgp.bt.simplify import simplify
from islandgp.commands.files import FILE, read_tree

COLOURS: Final = {Mark.DELETED: "red", Mark.INSERTED: "green", Mark.CHANGED: "yellow"}


@click.command()
@click.argument("old", type=FILE)
@click.argument("new", type=FILE)
@click.option("--all", "whole", is_flag=True, help="Show the unchanged nodes as well.")
def command(old: str, new: str, whole: bool) -> None:
    """Compare the trees in OLD and NEW, node by node.

    Marks: - deleted, + inserted, ~ changed. Exit code 1 when they differ.
    """
    a, b = read_tree(old), read_tree(new)
    if a == b:
        click.echo("The same tree.")
        return
    for line in _by_nodes(a, b, whole) if max(size(a), size(b)) <= MOST_NODES else _by_text(a, b):
        click.echo(line)
    if simplify(a).tree == simplify(b).tree:
        click.echo("Written differently, but they do the same.")
    sys.exit(1)


def _by_nodes(a: Node, b: Node, whole: bool) -> Iterator[str]:
    lines = compare(a, b)
    for line in lines:
        if line.mark is Mark.SAME and not whole:
            continue
        texts = [label(node) for node in (line.old, line.new) if node is not None]
        if line.mark is Mark.SAME:
            texts = texts[:1]
        text = f"{line.mark} {'  ' * line.level}{' -> '.join(texts)}"
        yield click.style(text, fg=COLOURS.get(line.mark))
    counts = [sum(line.mark is mark for line in lines) for mark in COLOURS]
    yield "{} deleted, {} inserted, {} changed".format(*counts)


def _by_text(a: Node, b: Node) -> Iterator[str]:
    """For trees too large to compare node by node in reasonable time."""
    yield f"More than {MOST_NODES} nodes: comparing the canonical texts."
    yield from difflib.unified_diff(
        to_text(a).splitlines(), to_text(b).splitlines(), "OLD", "NEW", lineterm=""
    )
