"""Trees that run a node by a condition, as BehaviorTree.CPP's branching nodes and preconditions do.

A `Test` is a condition of keys, or a tree of condition leaves that answers within its tick.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

from islandgp.bt.core.condition import Compound, Condition, ConditionExpr, negate, opposite
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import Node, guarded, walk
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.bt.export.plan import SemanticDifference

Test: TypeAlias = ConditionExpr | Node

SKIPS: Final = ("_skipIf", "_while")
PRECONDITIONS: Final = ("_failureIf", "_successIf", *SKIPS)
"""Attributes, in the order in which they are evaluated."""

ASKED = SemanticDifference(
    "asked",
    "IfThenElse evaluates its condition once; islandgp evaluates it again when the second child"
    " succeeds, and runs the third if the condition is false then",
)
TWICE = SemanticDifference(
    "twice", "a condition leaf before two branches is evaluated for each of them"
)
SKIPPED = SemanticDifference(
    "skipped",
    "a node that a precondition skips is ignored, and so is its composite if all children are"
    " skipped; in islandgp the node ends with the status after which its composite continues",
)


def only_if(test: Test, child: Node, abort: str) -> Node:
    """A node that fails if the test does not hold; `abort` is none or self."""
    if isinstance(test, Condition | Compound):
        return guarded(test, child, abort)
    return Node("sequence" if abort == "none" else "reactive_sequence", (), (test, child))


def implies(test: Test, child: Node, abort: str) -> Node:
    """A node that succeeds if the test does not hold; `abort` is none or self."""
    if isinstance(test, Condition | Compound):
        return _inverted(guarded(test, _inverted(child), abort))
    return Node(
        "selector" if abort == "none" else "reactive_selector", (), (_inverted(test), child)
    )


def unless(test: Test) -> Test:
    """The negation of a test."""
    return _inverted(test) if isinstance(test, Node) else negated(test)


def negated(expr: ConditionExpr) -> ConditionExpr:
    """The negation of a condition."""
    return negate(expr) if isinstance(expr, Compound) else opposite(expr)


def if_then_else(test: Test, children: Sequence[Node]) -> Node:
    """A tree of an IfThenElse without its first child."""
    if len(children) == 1:
        return only_if(test, children[0], "none")
    success_branch, otherwise = children
    parts = (implies(test, success_branch, "none"), implies(unless(test), otherwise, "none"))
    return Node("sequence", (), parts)


def while_do_else(test: Test, children: Sequence[Node]) -> Node:
    """A tree of a WhileDoElse without its first child."""
    if len(children) == 1:
        return only_if(test, children[0], "self")
    success_branch, otherwise = children
    if isinstance(test, Condition | Compound):  # the guards halt a branch before the other starts
        branches = (guarded(test, success_branch), guarded(negated(test), otherwise, "self"))
        return Node("selector", (), branches)
    parts = (implies(test, success_branch, "self"), implies(unless(test), otherwise, "self"))
    return Node("reactive_sequence", (), parts)


def switch(cases: Sequence[ConditionExpr], children: Sequence[Node]) -> Node:
    """A tree that runs the child of the first case that holds, else the last child."""
    *branches, node = children
    for case, branch in reversed(list(zip(cases, branches, strict=True))):
        node = while_do_else(case, (branch, node))
    return node


def answers_at_once(tree: Node, vocabulary: Vocabulary) -> bool:
    """True if a tree has condition leaves, selectors, sequences and inverters only."""
    return all(
        vocabulary.action(node.action).condition
        if node.action
        else kind_of(node).inverts or kind_of(node).advance_status is not None
        for node in walk(tree)
    )


def _inverted(node: Node) -> Node:
    """A node with success and failure exchanged."""
    return node.children[0] if kind_of(node).inverts else Node("inverter", (), (node,))
