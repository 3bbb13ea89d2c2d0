"""A tree as text for graph drawing tools: Graphviz's dot language and Mermaid flowcharts."""

from __future__ import annotations

from collections.abc import Iterator
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
        *_dot_lines(tree, iter(range(10**9))),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _dot_lines(node: Node, places: Iterator[int], parent: str = "") -> Iterator[str]:
    name = f"n{next(places)}"
    fill, stroke = COLOURS[node.kind]
    shape = _DOT_SHAPES.get(node.kind, "box")
    yield (f'  {name} [label="{label(node)}", shape={shape}, fillcolor="{fill}", color="{stroke}"]')
    if parent:
        yield f"  {parent} -> {name}"
    for child in node.children:
        yield from _dot_lines(child, places, name)


def to_mermaid(tree: Node) -> str:
    """The text of a flowchart; nodes are n0, n1, ... in document order."""
    lines = ["flowchart TD"]
    lines += _mermaid_lines(tree, iter(range(10**9)))
    for kind, (fill, stroke) in COLOURS.items():
        lines.append(f"  classDef {kind} fill:{fill},stroke:{stroke},color:#1b2733")
    return "\n".join(lines) + "\n"


def _mermaid_lines(node: Node, places: Iterator[int], parent: str = "") -> Iterator[str]:
    name = f"n{next(places)}"
    left, right = _MERMAID_SHAPES.get(node.kind, ("[", "]"))
    yield f'  {name}{left}"{label(node).translate(_ESCAPES)}"{right}:::{node.kind}'
    if parent:
        yield f"  {parent} --- {name}"
    for child in node.children:
        yield from _mermaid_lines(child, places, name)
