"""Removes the parts of new trees that have no effect."""

from __future__ import annotations

from typing import Final

from islandgp.bt.analysis.simplify import simplify
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary

NEW_WORLD: Final = False
"""True: evolution uses all of `clean`, and mutations keep whole numbers with noise whole. This
changes the records of all runs, so it is one switch."""


def clean(tree: Node, vocabulary: Vocabulary, *, new_world: bool = NEW_WORLD) -> Node:
    """The tree without parts that provably have no effect.

    Args:
        tree: a random tree or a child.
        vocabulary: the declared actions and keys.
        new_world: False: keep what is without effect only because of earlier siblings.
    """
    return simplify(tree, vocabulary, siblings=new_world).tree
