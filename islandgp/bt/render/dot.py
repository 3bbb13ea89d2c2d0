"""A tree in Graphviz's dot language."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from islandgp.bt.node import Node
from islandgp.bt.render.label import label
from islandgp.bt.render.svg import COLOURS

_SHAPES: Final = {"when": "hexagon", "action": "ellipse"}


def to_dot(tree: Node) -> str:
    """The text of a digraph; nodes are n0, n1, ... in document order."""
    lines = [
        "digraph tree {",
        '  graph [ordering=out, rankdir=TB, fontname="Helvetica"]',
        '  node [style="filled", fontname="Helvetica", fontsize=11]',
        "  edge [arrowhead=none]",
        *_lines(tree, iter(range(10**9))),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _lines(node: Node, places: Iterator[int], parent: str = "") -> Iterator[str]:
    name = f"n{next(places)}"
    fill, stroke = COLOURS[node.kind]
    shape = _SHAPES.get(node.kind, "box")
    yield (f'  {name} [label="{label(node)}", shape={shape}, fillcolor="{fill}", color="{stroke}"]')
    if parent:
        yield f"  {parent} -> {name}"
    for child in node.children:
        yield from _lines(child, places, name)
