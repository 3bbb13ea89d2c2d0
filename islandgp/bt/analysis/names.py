"""Names of subtrees for reviewers: those of other trees, and new ones for branches that repeat."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from typing import Final

from islandgp.bt.core.kinds import NAME, RESERVED
from islandgp.bt.core.node import Node, as_subtree, names_of, size, walk
from islandgp.bt.core.vocabulary import Vocabulary

REPEATED: Final = 3  # least nodes of a branch that gets a name because it repeats


def with_names(tree: Node, vocabulary: Vocabulary, others: Sequence[Node] = ()) -> Node:
    """A tree with names of its subtrees, as they are printed by `with_subtrees`.

    Args:
        tree: any tree; its own names are lost.
        vocabulary: its words are no names of subtrees.
        others: trees with named subtrees, whose names equal branches get.

    Returns:
        The equal tree. A branch of at least REPEATED nodes that repeats is named after its last
        action.
    """
    names = {
        node: names_of(node)[0]
        for other in others
        for node in walk(other)
        if names_of(node) and NAME.fullmatch(names_of(node)[0])
    }
    times = Counter(node for node in walk(tree) if size(node) >= REPEATED)
    taken = {*RESERVED, *vocabulary.actions, *vocabulary.keys, *names.values()}

    def visit(node: Node, may_name: bool) -> Node:
        if may_name and node not in names and times[node] > 1:
            names[node] = _new_name(node, taken)
            taken.add(names[node])
        inside = may_name and not (node in names and times[node] > 1)
        named = Node(node.kind, node.args, tuple([visit(c, inside) for c in node.children]))
        return as_subtree(named, names[node]) if node in names else named

    return visit(tree, True)


def _new_name(node: Node, taken: Collection[str]) -> str:
    """A free name after the last action of a node, if any, such as `execute_charge`."""
    last = [node.kind, *(each.action for each in walk(node) if each.action)][-1]
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", last).lower()
    return fresh_name(words, taken)


def fresh_name(name: str, taken: Collection[str]) -> str:
    """A valid name like `name` that is not in `taken`: recharge_20_3 for `recharge(20, 3)`."""
    prefix = re.sub(r"[^A-Za-z0-9_]+", "_", name.replace("-", "minus_").removesuffix(")"))
    prefix = prefix if prefix[:1].isalpha() or prefix[:1] == "_" else f"tree_{prefix}"
    candidate, number = prefix, 1
    while candidate in taken:
        number += 1
        candidate = f"{prefix}_{number}"
    return candidate
