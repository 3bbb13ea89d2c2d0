"""The possible statuses of a node, from those of its actions."""

from __future__ import annotations

from typing import Final, TypeAlias

from islandgp.bt.analysis.truth import NodeContext, child_context, excludes, may_interrupt
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import FAILURE, SUCCESS, GuardArgs, Node, ParallelArgs

Ends: TypeAlias = frozenset[int]  # of SUCCESS and FAILURE

_FAILS: Final[Ends] = frozenset({FAILURE})
_ANY: Final[Ends] = frozenset({FAILURE, SUCCESS})


def ends(node: Node, context: NodeContext) -> Ends:
    """The statuses with which a node can end; a superset where it is not known exactly."""
    if node.action:
        return context.vocabulary.action(node.action).statuses & _ANY
    guard = node.guard
    if guard and never(guard, context):
        return _FAILS
    kind = kind_of(node)
    if kind.opaque:
        return _ANY
    each = (child_ends(node, context, index) for index in range(len(node.children)))
    if kind.decorates:
        statuses = frozenset([kind.ends[end] for end in next(each)])
        return statuses | _FAILS if guard or kind.may_fail else statuses
    if isinstance(node.args, ParallelArgs):
        return _parallel(node.args, list(each))
    advance = advance_status(node)
    reached: Ends = frozenset()  # without `advance`
    for child in each:
        reached |= child - {advance}
        if advance not in child:
            return reached
    return reached | {advance}


def child_ends(node: Node, context: NodeContext, index: int) -> Ends:
    """The statuses with which a child can end, or more; `context` is the parent's."""
    child = node.children[index]
    # What a leaf returns does not depend on its place, whose context takes time to make.
    return ends(child, context if child.action else child_context(node, context, index))


def child_may_end(node: Node, context: NodeContext, index: int, status: int) -> bool:
    """True if `child_ends` has this status; `context` is the parent's."""
    child = node.children[index]
    if status == FAILURE and (child.guard or kind_of(child).may_fail):
        return True  # independent of the nodes below it
    return status in child_ends(node, context, index)


def advance_status(node: Node) -> int:
    """The status of a child after which a selector or sequence starts the next one."""
    status = kind_of(node).advance_status
    assert status is not None
    return status


def dead_end(node: Node, context: NodeContext) -> int | None:
    """Index of the first child after which no later child can run, or None.

    The last child does not count.
    """
    advance = advance_status(node)
    for index in range(len(node.children) - 1):
        if not child_may_end(node, context, index, advance):
            return index
    return None


def never(guard: GuardArgs, context: NodeContext) -> bool:
    """True if the condition of a `when` cannot hold when the guard starts."""
    return excludes(context.at_start, guard.condition)


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


def _parallel(args: ParallelArgs, children: list[Ends]) -> Ends:
    success, failure = args.needed(len(children))
    failing, succeeding = (sum(end in e for e in children) for end in (FAILURE, SUCCESS))
    # If all children have ended without a decision, too few succeeded: it fails.
    statuses = {
        FAILURE: failing >= min(failure, len(children) - success + 1),
        SUCCESS: succeeding >= success,
    }
    return frozenset(end for end in statuses if statuses[end])
