"""A tree as an SVG picture that stands alone."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Final

from islandgp.bt.node import KINDS, Node
from islandgp.bt.render.label import label
from islandgp.bt.render.layout import BOX, PADDING, Box, lay_out

COLOURS: Final[dict[str, tuple[str, str]]] = {
    "selector": ("#d7ecfa", "#0072b2"),
    "sequence": ("#dfe6f7", "#3f5fa8"),
    "parallel": ("#f3e0ec", "#a8437e"),
    "inverter": ("#fbe3d6", "#d55e00"),
    "repeater": ("#efe3f5", "#7f4fa3"),
    "when": ("#fdf0cf", "#b57a00"),
    "action": ("#d6f1e6", "#00775a"),
}
"""Fill and line of each kind of node; kinds differ in shape and sign too."""

FONT: Final = "ui-monospace,'DejaVu Sans Mono',Menlo,Consolas,monospace"


def to_svg(tree: Node) -> str:
    """The picture as the text of an SVG file."""
    boxes, width, height = lay_out(tree)
    style = "".join(
        f".{kind} path{{fill:{fill};stroke:{stroke}}}" for kind, (fill, stroke) in COLOURS.items()
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
        f"<title>{escape(label(node))}: {escape(KINDS[node.kind].meaning)}</title>"
        f'<path d="{_outline(node.kind, box.width)}"/>'
        f'<text x="{PADDING / 2:g}" y="4" textLength="{box.width - PADDING:g}"'
        f' xml:space="preserve">{escape(label(node))}</text></g>\n'
    )


def _outline(kind: str, width: float) -> str:
    """A box with the left edge at 0 and the middle at height 0: the shape tells the kind."""
    half = BOX / 2
    if kind == "when":  # pointed ends
        return f"M6 {-half:g}H{width - 6:g}L{width:g} 0L{width - 6:g} {half:g}H6L0 0Z"
    corner = half if kind == "action" else 4
    arc = f"a{corner:g} {corner:g} 0 0 1"
    inner, side = width - 2 * corner, BOX - 2 * corner
    return (
        f"M{corner:g} {-half:g}h{inner:g}{arc} {corner:g} {corner:g}v{side:g}"
        f"{arc} {-corner:g} {corner:g}h{-inner:g}{arc} {-corner:g} {-corner:g}v{-side:g}"
        f"{arc} {corner:g} {-corner:g}Z"
    )
