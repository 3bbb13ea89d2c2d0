"""Nodes after which a composite never goes on, that never do anything, or never succeed."""

from __future__ import annotations

from collections.abc import Iterator

from islandgp.bt.analysis.context import (
    NodeContext,
    child_context,
    child_contexts,
    end_facts,
    may_interrupt,
    never,
)
from islandgp.bt.analysis.satisfiability import Conditions, excludes
from islandgp.bt.core.condition import Condition
from islandgp.bt.core.kinds import advance_status, kind_of
from islandgp.bt.core.node import FAILURE, Node


def child_may_end(node: Node, context: NodeContext, index: int, status: int) -> bool:
    """True if a child can end with this status; `context` is the parent's."""
    child = node.children[index]
    # What a leaf returns does not depend on its place, whose context takes time to make.
    here = context if child.action else child_context(node, context, index)
    return end_facts(child, here, status) is not None


def dead_end(node: Node, context: NodeContext) -> int | None:
    """Index of the first child after which no later child can run, or None.

    The last child does not count.
    """
    advance = advance_status(node)
    for index, (child, here) in enumerate(
        zip(node.children[:-1], child_contexts(node, context), strict=False)
    ):
        if end_facts(child, here, advance) is None:
            return index
    return None


def idle(node: Node, context: NodeContext) -> int | None:
    """The status of a node that always ends in its first tick without effect; None for others.

    Such a node calls no action and stops no other node.
    """
    kind = kind_of(node)
    if not kind.decorates or kind.opaque:
        return None
    if node.guard:
        # If the guarded child never starts, its guards are never observed.
        if not never(node.guard, context) and child_idle(node, context, 0) != FAILURE:
            return None
        return None if may_interrupt(node.guard, context) else FAILURE
    end = child_idle(node, context, 0)
    if end is None or end == kind.counts or kind.delayed or (kind.may_fail and end != FAILURE):
        return None
    return kind.ends[end]


def child_idle(node: Node, context: NodeContext, index: int) -> int | None:
    """`idle` of a child; `context` is the parent's."""
    child = node.children[index]
    return idle(child, child_context(node, context, index)) if kind_of(child).decorates else None


def contradictions(node: Node, context: NodeContext) -> Iterator[tuple[Condition, Conditions]]:
    """What an action needs to succeed but cannot have in its place, with what holds there."""
    action = context.vocabulary.action(node.action)
    for needed, holding in (
        *((needed, context.at_start) for needed in action.to_start),
        *((needed, context.always) for needed in action.to_succeed),
    ):
        if excludes(holding, needed):
            yield needed, holding
