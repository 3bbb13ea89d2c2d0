"""Pictures of trees: in a terminal and as SVG.

The SVG is self-contained. The root is at the left, and each leaf has a row. So branches are tried
from top to bottom, as in the text, and a large tree grows in height, not in width.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING, Final, NamedTuple

from islandgp.bt.core.kinds import KINDS, kind_of
from islandgp.bt.core.node import Node
from islandgp.bt.core.printer import head

if TYPE_CHECKING:
    from rich.text import Text


def label(node: Node) -> str:
    """One line that names a node: its sign and its canonical head."""
    text = head(node)
    if node.guard:  # its sign replaces the word
        text = text.removeprefix(f"{node.kind} ")
    return f"{kind_of(node).look.sign} {text}".strip()


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


def to_rich(tree: Node, notes: Sequence[Text] | None = None) -> Text:
    """The tree in colours, with an optional note after each node (in document order)."""
    from rich.text import Text

    labels = [
        Text().append(before, "dim").append(label(node), kind_of(node).look.style)
        for before, node in branches(tree)
    ]
    if notes is not None:
        width = max(line.cell_len for line in labels) + 2
        for line, note in zip(labels, notes, strict=True):
            line.pad_right(width - line.cell_len)
            line.append(note)
    return Text("\n").join(labels)


ROW = 28.0  # px from leaf to leaf
BOX = 22.0  # px, height of a box
GAP = 26.0  # px from a box to its children
LETTER = 6.9  # px a letter of the 11.5 px monospaced font
PADDING = 16.0  # px left and right of a label together
MARGIN = 8.0  # px around everything


class Box(NamedTuple):
    """A node's place in the picture, in px from its upper left corner."""

    node: Node
    parent: int  # place of the parent in document order, -1 for the root
    x: float  # left edge
    y: float  # middle
    width: float


def lay_out(tree: Node) -> tuple[list[Box], float, float]:
    """The boxes in document order, and width and height of the picture."""
    boxes: list[Box] = []
    leaves = 0

    def visit(node: Node, parent: int, x: float) -> float:
        """Add the boxes of a node and its descendants; returns the node's row."""
        nonlocal leaves
        place, width = len(boxes), PADDING + LETTER * len(label(node))
        boxes.append(Box(node, parent, x, 0.0, width))
        rows = [visit(child, place, x + width + GAP) for child in node.children] or [leaves]
        leaves += not node.children
        row = (rows[0] + rows[-1]) / 2  # midway between the first and the last child
        boxes[place] = boxes[place]._replace(y=MARGIN + ROW * (row + 0.5))
        return row

    visit(tree, -1, MARGIN)
    right = max(box.x + box.width for box in boxes)
    return boxes, right + MARGIN, 2 * MARGIN + ROW * leaves


FONT: Final = "ui-monospace,'DejaVu Sans Mono',Menlo,Consolas,monospace"


def to_svg(tree: Node) -> str:
    """The picture as the text of an SVG file."""
    boxes, width, height = lay_out(tree)
    style = "".join(
        f".{name} path{{fill:{kind.look.fill};stroke:{kind.look.line}}}"
        for name, kind in KINDS.items()
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}"'
        f' viewBox="0 0 {width:g} {height:g}" role="img">\n'
        f"<style>svg{{background:#fff}}.edge{{fill:none;stroke:#9aa7b3;stroke-width:1.3}}"
        f"text{{font:11.5px {FONT};fill:#1b2733}}{style}</style>\n" + drawing(boxes) + "</svg>\n"
    )


def drawing(boxes: list[Box]) -> str:
    """The edges (class `edge`), then the nodes (class `node` and the kind) in document order."""
    return "".join([*_edges(boxes), *map(_node, boxes)])


def _edges(boxes: list[Box]) -> Iterator[str]:
    for box in boxes:
        if box.parent >= 0:
            above = boxes[box.parent]
            x, end = above.x + above.width, box.x
            middle = (x + end) / 2
            yield (
                f'<path class="edge" d="M{x:g} {above.y:g}'
                f'C{middle:g} {above.y:g} {middle:g} {box.y:g} {end:g} {box.y:g}"/>\n'
            )


def _node(box: Box) -> str:
    node = box.node
    return (
        f'<g class="node {node.kind}" transform="translate({box.x:g} {box.y:g})">'
        f"<title>{escape(label(node))}: {escape(kind_of(node).meaning)}</title>"
        f'<path d="{_outline(kind_of(node).look.ends, box.width)}"/>'
        f'<text x="{PADDING / 2:g}" y="4" textLength="{box.width - PADDING:g}"'
        f' xml:space="preserve">{escape(label(node))}</text></g>\n'
    )


def _outline(ends: str, width: float) -> str:
    """A box with the left edge at 0 and the middle at height 0; `ends` as in `Look`."""
    half = BOX / 2
    if ends == "pointed":
        return f"M6 {-half:g}H{width - 6:g}L{width:g} 0L{width - 6:g} {half:g}H6L0 0Z"
    corner = half if ends == "round" else 4
    arc = f"a{corner:g} {corner:g} 0 0 1"
    inner, side = width - 2 * corner, BOX - 2 * corner
    return (
        f"M{corner:g} {-half:g}h{inner:g}{arc} {corner:g} {corner:g}v{side:g}"
        f"{arc} {-corner:g} {corner:g}h{-inner:g}{arc} {-corner:g} {-corner:g}v{-side:g}"
        f"{arc} {corner:g} {-corner:g}Z"
    )
