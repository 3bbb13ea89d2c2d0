"""A tree as a Mermaid flowchart, which forges and notebooks draw by themselves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from islandgp.bt.node import Node
from islandgp.bt.render.label import label
from islandgp.bt.render.svg import COLOURS

_SHAPES: Final[dict[str, tuple[str, str]]] = {
    "when": ("{{", "}}"),
    "action": ("([", "])"),
}
_ESCAPES: Final = str.maketrans({"<": "&lt;", ">": "&gt;", '"': "&quot;"})


def to_mermaid(tree: Node) -> str:
    """The text of a flowchart; nodes are n0, n1, ... in document order."""
    lines = ["flowchart TD"]
    lines += _lines(tree, iter(range(10**9)))
    for kind, (fill, stroke) in COLOURS.items():
        lines.append(f"  classDef {kind} fill:{fill},stroke:{stroke},color:#1b2733")
    return "\n".join(lines) + "\n"


def _lines(node: Node, places: Iterator[int], parent: str = "") -> Iterator[str]:
    name = f"n{next(places)}"
    left, right = _SHAPES.get(node.kind, ("[", "]"))
    yield f'  {name}{left}"{label(node).translate(_ESCAPES)}"{right}:::{node.kind}'
    if parent:
        yield f"  {parent} --- {name}"
    for child in node.children:
        yield from _lines(child, places, name)
