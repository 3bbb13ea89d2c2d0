"""How large a tree may be (section 2.2.3: depth 8, 50 nodes)."""

from __future__ import annotations

from dataclasses import dataclass

from islandgp.bt.node import Node, depth, size
from islandgp.errors import LimitError


@dataclass(frozen=True, slots=True)
class Limits:
    """The largest tree that is allowed; a `use` counts expanded."""

    max_depth: int  # levels, >= 1
    max_nodes: int  # nodes, >= 1


def within(node: Node, limits: Limits) -> bool:
    """Whether a tree keeps its limits."""
    return depth(node) <= limits.max_depth and size(node) <= limits.max_nodes


def check_limits(node: Node, limits: Limits) -> None:
    """Raises LimitError for a tree that is too deep or too large."""
    for name, found, most in (
        ("depth", depth(node), limits.max_depth),
        ("size", size(node), limits.max_nodes),
    ):
        if found > most:
            what = "levels" if name == "depth" else "nodes"
            raise LimitError(
                f"Expected a tree of at most {most} {what}, found {found};"
                " shorten it or raise the limit."
            )
