"""What stands in a node's box."""

from __future__ import annotations

from typing import Final

from islandgp.bt.node import Node
from islandgp.bt.printer import head

SYMBOLS: Final[dict[str, str]] = {
    "selector": "?",
    "sequence": "\N{RIGHTWARDS ARROW}",
    "parallel": "\N{RIGHTWARDS PAIRED ARROWS}",
    "inverter": "\N{NOT SIGN}",
    "repeater": "\N{CLOCKWISE OPEN CIRCLE ARROW}",
    "when": "\N{WHITE DIAMOND}",
    "action": "",
}
"""A sign per kind of node, as the literature draws them."""


def label(node: Node) -> str:
    """One line that names a node: its sign and its canonical head."""
    text = head(node).removeprefix("when ")
    return f"{SYMBOLS[node.kind]} {text}".strip()
