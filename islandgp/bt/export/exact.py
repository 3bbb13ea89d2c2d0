"""A tree in the terms of another library and of our own nodes for it, without any loss.

Our nodes (`nodes/`) stand only where the library's own differ: a selector or
sequence that observes guards is an interruptible one, its guards are `When` nodes,
and a library says for itself which other kinds it needs ours for. A tree that
needs none of them is the same as in `plan`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, TypeAlias

from islandgp.bt.export.plan import TargetNode, in_subtrees
from islandgp.bt.node import Node
from islandgp.bt.truth import checks_itself, exposes

OWN: Final = frozenset({
    "when", "interruptible_fallback", "interruptible_sequence", "judged_parallel",
    "repeat_per_tick",
})  # fmt: skip
"""Kinds of parts that are nodes of ours, beside those of `plan`."""

Differs: TypeAlias = Callable[[Node], bool]
"""Whether a library's node for a parallel, a repeater or a `when` does something else."""


def exact_plan(node: Node, differs: Differs) -> TargetNode:
    """A tree in those terms."""
    return _part(node, differs, observed=False)


def parts(part: TargetNode) -> Iterator[TargetNode]:
    """The parts of a plan in document order."""
    yield part
    for child in part.children:
        yield from parts(child)


def own_nodes(name: str) -> str:
    """The text of a file with our nodes: islandgp_nodes.hpp or islandgp_nodes.py."""
    return (Path(__file__).parent / "nodes" / name).read_text(encoding="utf-8")


def _part(node: Node, differs: Differs, *, observed: bool) -> TargetNode:
    """A node; observed: a composite above looks for guards here, through decorators."""
    return in_subtrees(node, _bare(node, differs, observed=observed))


def _bare(node: Node, differs: Differs, *, observed: bool) -> TargetNode:
    """The same without the names of subtrees."""
    kind = node.kind
    if kind == "action":
        return TargetNode("action", node.args)
    if kind in ("when", "inverter", "repeater"):
        child = _part(node.children[0], differs, observed=observed)
        if kind == "when":
            return _when(node, child, ours=observed or exposes(node) or differs(node))
        if kind == "inverter":
            return TargetNode("inverter", (), (child,))
        return TargetNode("repeat_per_tick" if differs(node) else "repeat", node.args, (child,))
    if kind == "parallel":
        children = tuple(_part(child, differs, observed=False) for child in node.children)
        return TargetNode("judged_parallel" if differs(node) else "parallel", node.args, children)
    return _composite(node, differs)


def _when(node: Node, child: TargetNode, *, ours: bool) -> TargetNode:
    if ours:
        return TargetNode("when", node.args, (child,))
    kind = "reactive_sequence" if checks_itself(node) else "sequence"
    return TargetNode(kind, node.args, (TargetNode("check", node.args[:1]), child))


def _composite(node: Node, differs: Differs) -> TargetNode:
    plain = "fallback" if node.kind == "selector" else "sequence"
    *earlier, last = node.children
    observes = [exposes(branch) for branch in earlier]
    children = [
        _part(branch, differs, observed=observed)
        for branch, observed in zip(earlier, observes, strict=True)
    ]
    children.append(_part(last, differs, observed=False))
    return TargetNode(f"interruptible_{plain}" if any(observes) else plain, (), tuple(children))
