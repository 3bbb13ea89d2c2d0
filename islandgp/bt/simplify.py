"""Shortens a tree without changing what it does, by the rules of `rewrites`."""

from __future__ import annotations

from typing import NamedTuple

from islandgp.bt.node import Node
from islandgp.bt.rewrites import RULES, Rewrite
from islandgp.bt.truth import Standing, below, root_of
from islandgp.bt.vocabulary import NOTHING, Vocabulary


class Simplified(NamedTuple):
    """A shorter tree, and what was done to get it."""

    tree: Node
    reasons: tuple[str, ...]  # one a rewrite, in order; empty: nothing could be shortened


def simplify(tree: Node, vocabulary: Vocabulary = NOTHING) -> Simplified:
    """The shortest tree that the rules reach; simplifying it again changes nothing.

    What `vocabulary` says of actions and keys allows more rewrites.
    """
    reasons: list[str] = []
    while True:
        before = len(reasons)
        tree = _visit(tree, root_of(vocabulary), reasons)
        if len(reasons) == before:
            return Simplified(tree, tuple(reasons))


def _visit(node: Node, standing: Standing, reasons: list[str]) -> Node:
    """From the root down, so that what is known of a node's place stays true."""
    while (rewrite := _first(node, standing)) is not None:
        node, reason = rewrite
        reasons.append(reason)
    for index in range(len(node.children)):
        child = _visit(node.children[index], below(node, standing, index), reasons)
        children = (*node.children[:index], child, *node.children[index + 1 :])
        node = node._replace(children=children)
    return node


def _first(node: Node, standing: Standing) -> Rewrite:
    return next(
        (found for rule in RULES[node.kind] if (found := rule(node, standing)) is not None), None
    )
