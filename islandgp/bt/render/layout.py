"""Where each node of a drawn tree stands: the root at the left, a row for each leaf.

So order from top to bottom is the order in which branches are tried, as in the
text, and a large tree grows downwards instead of getting too wide to read.
"""

from __future__ import annotations

from dataclasses import dataclass

from islandgp.bt.node import Node, walk
from islandgp.bt.render.label import label

ROW = 28.0  # px from leaf to leaf
BOX = 22.0  # px, height of a box
GAP = 26.0  # px from a box to its children
LETTER = 6.9  # px a letter of the 11.5 px monospaced font
PADDING = 16.0  # px left and right of a label together
MARGIN = 8.0  # px around everything


@dataclass(frozen=True, slots=True)
class Box:
    """A node's place in the picture, in px from its upper left corner."""

    node: Node
    parent: int  # place of the parent in document order, -1 for the root
    x: float  # left edge
    y: float  # middle
    width: float


def lay_out(tree: Node) -> tuple[list[Box], float, float]:
    """The boxes in document order, and width and height of the picture."""
    rows, parents = _rows(tree)
    boxes: list[Box] = []
    for node, parent, row in zip(walk(tree), parents, rows, strict=True):
        left = MARGIN if parent < 0 else boxes[parent].x + boxes[parent].width + GAP
        width = PADDING + LETTER * len(label(node))
        boxes.append(Box(node, parent, left, MARGIN + ROW * (row + 0.5), width))
    right = max(box.x + box.width for box in boxes)
    return boxes, right + MARGIN, 2 * MARGIN + ROW * sum(not n.children for n in walk(tree))


def _rows(tree: Node) -> tuple[list[float], list[int]]:
    """Row and parent of each node in document order; a parent is midway between its children."""
    rows: list[float] = []
    parents: list[int] = []
    leaves = 0

    def visit(node: Node, parent: int) -> int:
        nonlocal leaves
        place = len(rows)
        rows.append(leaves)
        parents.append(parent)
        if not node.children:
            leaves += 1
            return place
        children = [visit(child, place) for child in node.children]
        rows[place] = (rows[children[0]] + rows[children[-1]]) / 2
        return place

    visit(tree, -1)
    return rows, parents
