"""A tree as text for graph drawing tools: Graphviz's dot language and Mermaid flowcharts."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from typing import Final

from islandgp.bt.node import Node
from islandgp.bt.render.label import label
from islandgp.bt.render.svg import COLOURS

_DOT_SHAPES: Final = {"when": "hexagon", "action": "ellipse"}
_MERMAID_SHAPES: Final[dict[str, tuple[str, str]]] = {
    "when": ("{{", "}}"),
    "action": ("([", "])"),
}
_ESCAPES: Final = str.maketrans({"<": "&lt;", ">": "&gt;", '"': "&quot;"})


def to_dot(tree: Node) -> str:
    """The text of a digraph; nodes are n0, n1, ... in document order."""
    lines = [
        "digraph tree {",
        '  graph [ordering=out, rankdir=TB, fontname="Helvetica"]',
        '  node [style="filled", fontname="Helvetica", fontsize=11]',
        "  edge [arrowhead=none]",
        *_dot_lines(tree),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _dot_lines(tree: Node) -> Iterator[str]:
    for name, node, parent in _named(tree, count()):
        fill, stroke = COLOURS[node.kind]
        look = f'shape={_DOT_SHAPES.get(node.kind, "box")}, fillcolor="{fill}", color="{stroke}"'
        yield f'  {name} [label="{label(node)}", {look}]'
        if parent:
            yield f"  {parent} -> {name}"


def _named(node: Node, places: Iterator[int], parent: str = "") -> Iterator[tuple[str, Node, str]]:
    """Each node in document order with its name, and its parent's ("" for none)."""
    name = f"n{next(places)}"
    yield name, node, parent
    for child in node.children:
        yield from _named(child, places, name)


def to_mermaid(tree: Node) -> str:
    """The text of a flowchart; nodes are n0, n1, ... in document order."""
    lines = ["flowchart TD"]
    for name, node, parent in _named(tree, count()):
        left, right = _MERMAID_SHAPES.get(node.kind, ("[", "]"))
        lines.append(f'  {name}{left}"{label(node).translate(_ESCAPES)}"{right}:::{node.kind}')
        if parent:
            lines.append(f"  {parent} --- {name}")
    for kind, (fill, stroke) in COLOURS.items():
        lines.append(f"  classDef {kind} fill:{fill},stroke:{stroke},color:#1b2733")
    return "\n".join(lines) + "\n"
