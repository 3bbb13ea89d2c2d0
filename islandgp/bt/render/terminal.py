"""A tree drawn with lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from islandgp.bt.node import Node
from islandgp.bt.render.label import label

if TYPE_CHECKING:
    from rich.text import Text

STYLES: Final[dict[str, str]] = {
    "selector": "bold cyan",
    "sequence": "bold blue",
    "parallel": "bold magenta",
    "inverter": "red",
    "repeater": "magenta",
    "when": "yellow",
    "action": "green",
}
"""How rich colours each kind; a terminal without colours shows the same text."""


def branches(node: Node, before: str = "", below: str = "") -> Iterator[tuple[str, Node]]:
    """Each node in document order, with the lines that lead to it."""
    yield before, node
    for i, child in enumerate(node.children):
        last = i == len(node.children) - 1
        yield from branches(
            child,
            below + ("\u2514\u2500 " if last else "\u251c\u2500 "),
            below + ("   " if last else "\u2502  "),
        )


def to_lines(tree: Node) -> list[str]:
    """The tree as plain text, a node a line."""
    return [before + label(node) for before, node in branches(tree)]


def to_rich(tree: Node, notes: Sequence[Text] | None = None) -> Text:
    """The tree in colours, with a note behind each node (in document order) if there are any."""
    from rich.text import Text

    drawn = [
        Text().append(before, "dim").append(label(node), STYLES[node.kind])
        for before, node in branches(tree)
    ]
    if notes is not None:
        width = max(line.cell_len for line in drawn) + 2
        for line, note in zip(drawn, notes, strict=True):
            line.pad_right(width - line.cell_len)
            line.append(note)
    return Text("\n").join(drawn)
