"""The width of a guard: how often its condition holds. It decides where a branch is inserted."""

from __future__ import annotations

from typing import Final

from islandgp.bt.core.condition import Condition, ConditionExpr
from islandgp.bt.core.node import Node
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.gp.branches import fine
from islandgp.gp.edits import Path, is_selector, nodes_with_paths

WIDENING_STEP: Final = 0.15  # step by which a guard is widened, as a share of its key's range


def width(expr: ConditionExpr, vocabulary: Vocabulary) -> float:
    """Share of blackboards on which a condition holds, in [0, 1], for uniformly distributed values.

    A flag and a comparison of two keys hold on half of them. A joined condition is estimated from
    its parts: `and` by the narrowest, `or` by the widest, as the parts may depend on each other.
    """
    if not isinstance(expr, Condition):
        parts = [width(part, vocabulary) for part in expr.parts]
        if expr.word == "not":
            return 1 - parts[0]
        return min(parts) if expr.word == "and" else max(parts)
    if expr.operator in ("is", "not") or not expr.single:
        return 0.5
    key = vocabulary.keys[expr.key]
    if key.words:
        return 1 / len(key.words) if expr.operator == "==" else 1 - 1 / len(key.words)
    below = min(1.0, max(0.0, (expr.number - key.low) / (key.high - key.low)))
    equal = min(1.0, key.step / (key.high - key.low))
    shares = {"<": below, ">": 1 - below, "=": equal, "!": 1 - equal}
    return shares[expr.operator[0]]


def guard_width(branch: Node, vocabulary: Vocabulary) -> float:
    """The width of a branch's guard, in [0, 1]; 1 without a guard."""
    return width(branch.guard.condition, vocabulary) if branch.guard else 1.0


def place_for(tree: Node, branch: Node, vocabulary: Vocabulary) -> int | None:
    """The index at which to insert a branch among the root's children.

    It is inserted before the first child with an equally wide or wider guard. None if the root is
    not a selector.
    """
    if not is_selector(tree):
        return None
    width = guard_width(branch, vocabulary)
    wider = (k for k, c in enumerate(tree.children) if guard_width(c, vocabulary) >= width)
    return next(wider, len(tree.children))


def same_child_guard(tree: Node, branch: Node) -> tuple[Path, Node] | None:
    """Path and node of the first guard in a tree with the same child as a branch's guard."""
    if not branch.guard:
        return None
    for path, node in nodes_with_paths(tree):
        if node.guard and node.children == branch.children:
            return path, node
    return None


def widened(expr: ConditionExpr, vocabulary: Vocabulary) -> float | None:
    """The number of a comparison, moved so that it holds more often.

    None for another condition, and if the number is at the end of the key's range.
    """
    if not isinstance(expr, Condition) or not expr.single:
        return None
    if expr.operator not in ("<", "<=", ">", ">="):
        return None
    key = vocabulary.keys[expr.key]
    step = WIDENING_STEP * (key.high - key.low) * (1 if expr.operator in ("<", "<=") else -1)
    number = fine(expr.number + step, key)
    return None if number == expr.number else number
