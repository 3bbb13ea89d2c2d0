"""Prints a tree as canonical text: the genome that is hashed, cached, logged and sent.

Equal trees have equal text, and parsing the text gives the tree again.
"""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal
from functools import lru_cache

from islandgp.bt.node import ABORTS, Node

WIDTH = 80  # columns of a line
INDENT = "  "
INLINE_LEVELS = 3  # levels that one line may hold: deeper ones are hard to read


@lru_cache(maxsize=256)  # a run asks for each tree of a generation several times
def to_text(node: Node) -> str:
    """The canonical text of a tree; it ends in a line end.

    A node stands on one line when it fits, is at most three levels deep and
    holds no composite of anything but leaves. Defaults are not printed.
    """
    return "\n".join(_lines(node, "")) + "\n"


def number_text(value: float) -> str:
    """A number without exponent and without needless decimals: `25`, `12.5`."""
    if value == int(value):
        return str(int(value))
    return format(Decimal(repr(float(value))), "f")


def head(node: Node) -> str:
    """What stands before a node's brace; the whole of a leaf: `when charge < 25`."""
    if node.kind == "action":
        return str(node.args[0])
    if node.kind == "repeater":
        return f"repeater {number_text(float(node.args[0]))}"
    if node.kind == "parallel":
        success, failure = node.args
        return (
            "parallel"
            + ("" if success == "all" else f" success {success}")
            + ("" if failure == "one" else f" failure {failure}")
        )
    if node.kind == "when":
        return _when_head(node)
    return node.kind


def _when_head(node: Node) -> str:
    key, operator, number, abort = node.args
    if operator == "is":
        condition = f"{key}"
    elif operator == "not":
        condition = f"not {key}"
    else:
        condition = f"{key} {operator} {number_text(float(number))}"
    return f"when {condition}" + ("" if abort == ABORTS[-1] else f" abort {abort}")


def _lines(node: Node, indent: str) -> Iterator[str]:
    inline = _inline(node, INLINE_LEVELS)
    if inline is not None and (len(indent) + len(inline) <= WIDTH or not node.children):
        yield f"{indent}{inline}"
        return
    yield f"{indent}{head(node)} {{"
    for child in node.children:
        yield from _lines(child, indent + INDENT)
    yield f"{indent}}}"


def _inline(node: Node, levels: int) -> str | None:
    """The node as one line of any length; None if that would be hard to read."""
    if not node.children:
        return head(node)
    if levels == 1 or (len(node.children) > 1 and any(c.children for c in node.children)):
        return None
    inside = [_inline(child, levels - 1) for child in node.children]
    if None in inside:
        return None
    return f"{head(node)} {{ {' '.join(map(str, inside))} }}"
