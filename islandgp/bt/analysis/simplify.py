"""Simplifies a tree without changing its behaviour.

The simplified tree calls the same actions in the same ticks and ends with the same statuses, on
every blackboard and for all statuses that the vocabulary declares for the actions. The draws of a
`random_selector` depend on its place, which a rewrite may change. Each rule has a
comment with its justification; the semantics are those of docs/semantics.md. A rewrite must neither
add nor remove a guard that a composite observes while a later branch runs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.analysis.context import (
    NodeContext,
    always_holds,
    child_contexts,
    conditions_when_evaluated,
    effective_abort,
    end_facts,
    has_interrupting_guard,
    may_interrupt,
    never,
    root_context,
    without_interrupts,
)
from islandgp.bt.analysis.satisfiability import shortened, without_decimals
from islandgp.bt.core.kind import NodeKind
from islandgp.bt.core.kinds import KINDS, REPEATS, advance_status, is_opaque, kind_of
from islandgp.bt.core.node import FAILURE, CountArgs, GuardArgs, Node, count_of, guard_of
from islandgp.bt.core.printer import condition_text, head
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary

Rewrite: TypeAlias = tuple[Node, str] | None  # the simpler node and the reason; None: no change


def _idle(node: Node, context: NodeContext) -> int | None:
    """The status of a node that always ends in its first tick without effect; None for others.

    Such a node calls no action and stops no other node.
    """
    kind = kind_of(node)
    if not kind.decorates or is_opaque(node):
        return None
    if node.guard:
        # If the guarded child never starts, its guards are never observed.
        if not never(node.guard, context) and _child_idle(node, context) != FAILURE:
            return None
        return None if may_interrupt(node.guard, context) else FAILURE
    end = _child_idle(node, context)
    if end is None or end == kind.counts or kind.delayed or (kind.may_fail and end != FAILURE):
        return None
    return kind.ends[end]


def _child_idle(node: Node, context: NodeContext) -> int | None:
    """`_idle` of the only child; `context` is the parent's."""
    child = node.children[0]
    return _idle(child, child_contexts(node, context)[0]) if kind_of(child).decorates else None


def _only_child(node: Node, context: NodeContext) -> Rewrite:
    # A composite with one child has the status of the child.
    if len(node.children) > 1:
        return None
    # But the child's guards were not observed, and must not become observed.
    child = node.children[0]
    moved = child if context.when_observed is None else without_interrupts(child)
    return moved, f"{head(node)} has one child"


def never_gets_there(node: Node, context: NodeContext) -> Rewrite:
    # The composite never goes on from a child that never ends with the status for it.
    advance = advance_status(node)
    contexts = child_contexts(node, context)
    for index, child in enumerate(node.children[:-1]):
        if end_facts(child, contexts[index], advance) is None:
            verb = "fails" if advance == FAILURE else "succeeds"
            reason = f"{head(child)} never {verb}, so its {node.kind} never goes on"
            return node._replace(children=node.children[: index + 1]), reason
    return None


def _idle_branch(node: Node, context: NodeContext) -> Rewrite:
    # The next branch starts in the same tick, and the guards never become true.
    advance = advance_status(node)
    busy: list[Node] = []
    idling: list[Node] = []
    for child, here in zip(node.children, child_contexts(node, context), strict=True):
        (idling if _idle(child, here) == advance else busy).append(child)
    if not idling or len(node.children) == 1:
        return None
    rest = tuple(busy or idling[-1:])
    return node._replace(children=rest), f"{head(idling[0])} never does anything"


def _same_inside(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001 -- every rule's form
    # As the last child, the inner composite observes the guards that the outer one would.
    # As another child it must have no such guards, as the outer one would observe them for longer.
    *earlier, last = node.children
    children: list[Node] = []
    for child in earlier:
        if child.kind == node.kind and not any(map(has_interrupting_guard, child.children[:-1])):
            children += (*child.children[:-1], without_interrupts(child.children[-1]))
        else:
            children.append(child)
    children += last.children if last.kind == node.kind else (last,)
    if len(children) == len(node.children):
        return None
    return node._replace(children=tuple(children)), f"{node.kind} directly in a {node.kind}"


def double_inverter(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    child = node.children[0]
    undone = "double inverter: the two undo each other"
    return (child.children[0], undone) if kind_of(child).inverts else None


def _repeats_once(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    return (node.children[0], head(node)) if count_of(node) == 1 else None


def _double_repeater(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    # Both take one tick for each success, and fail at the first failure.
    child = node.children[0]
    if child.kind != node.kind:
        return None
    count = count_of(node) * count_of(child)
    if count > REPEATS[1]:
        return None
    return Node(node.kind, CountArgs(count), child.children), f"{node.kind} in a {node.kind}"


def _forced(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    # The node ends with its fixed status in the tick in which the child ends, with any status.
    child = node.children[0]
    if not (kind_of(child).inverts or kind_of(child).forces):
        return None
    return node._replace(children=child.children), f"{node.kind} above {child.kind}"


def holds_anyway(node: Node, context: NodeContext) -> Rewrite:
    # The guard always starts its child, and stops neither its child nor a later branch.
    guard = guard_of(node)
    if not always_holds(guard, context) or may_interrupt(guard, context):
        return None
    return node.children[0], f"{head(node)} always holds here"


def _guard_twice(node: Node, context: NodeContext) -> Rewrite:
    # The inner guard is evaluated when the condition holds. So if it would see the condition become
    # true, the outer guard does, too, provided that it interrupts as well.
    guard, child = guard_of(node), node.children[0]
    inner = child.guard
    if inner is None or inner.condition != guard.condition:
        return None
    if may_interrupt(inner, child_contexts(node, context)[0]) and not guard.interrupts:
        return None
    stops = guard.checks_itself or inner.checks_itself
    abort = {(0, 0): "none", (1, 0): "self", (0, 1): "lower", (1, 1): "both"}
    args = guard._replace(abort=abort[(stops, guard.interrupts)])
    return Node(node.kind, args, child.children), f"{head(node)} twice"


def shorter_condition(node: Node, context: NodeContext) -> Rewrite:
    # The two conditions are equal in every tick in which the guard is evaluated.
    guard = guard_of(node)
    condition = shortened(guard.condition, conditions_when_evaluated(guard, context))
    if condition == guard.condition:
        return None
    changed = node._replace(args=guard._replace(condition=condition))
    return changed, f"{head(node)} is equivalent to a shorter one: {condition_text(condition)}"


def whole_numbers(node: Node, context: NodeContext) -> Rewrite:
    # No whole number lies between a threshold and the rounded one.
    guard = guard_of(node)
    condition = without_decimals(guard.condition, context.vocabulary)
    if condition == guard.condition:
        return None
    changed = node._replace(args=guard._replace(condition=condition))
    texts = condition_text(guard.condition), condition_text(condition)
    return changed, "of whole numbers, {} is {}".format(*texts)


def _needless_abort(node: Node, context: NodeContext) -> Rewrite:
    # The parts that differ never stop a node: the child ends in the tick in which it starts, the
    # condition does not change while the child or a later branch runs, or there is no later branch.
    guard = guard_of(node)
    if (abort := effective_abort(node, context)) == guard.abort:
        return None
    changed = node._replace(args=guard._replace(abort=abort))
    return changed, f"abort {guard.abort} of {head(node)} has the effect of abort {abort}"


def _rules(kind: NodeKind) -> tuple[Callable[[Node, NodeContext], Rewrite], ...]:
    """The rules for the nodes of a kind, in the order of their application."""
    if kind.advance_status is not None:
        return (_only_child, never_gets_there, _idle_branch, _same_inside)
    if kind.args is GuardArgs:
        return (holds_anyway, _guard_twice, shorter_condition, whole_numbers, _needless_abort)
    if kind.counts is not None:
        return (_repeats_once, _double_repeater)
    if kind.forces:
        return (_forced,)
    if kind.inverts:
        return (double_inverter,)
    return (_only_child,) if kind.concurrent else ()


RULES: Final = {name: _rules(kind) for name, kind in KINDS.items()}

MAX_VISITS: Final = 20_000  # entries of a cache; trees of a search share most branches


class Simplified(NamedTuple):
    """A simplified tree, with the reasons of the rewrites."""

    tree: Node
    reasons: tuple[str, ...]  # of each rewrite, in order; empty: the tree is unchanged


def simplify(tree: Node, vocabulary: Vocabulary = EMPTY_VOCABULARY) -> Simplified:
    """Apply the rules until none applies.

    Args:
        tree: the root.
        vocabulary: its declarations of actions and keys allow more rewrites.
    """
    reasons: list[str] = []
    while True:
        tree, new = _visit(tree, root_context(tree, vocabulary))
        if not new:
            return Simplified(tree, tuple(reasons))
        reasons += new


@lru_cache(MAX_VISITS)
def _visit(node: Node, context: NodeContext) -> tuple[Node, tuple[str, ...]]:
    """Rewrites nodes from the root down, so the context of a node stays valid."""
    reasons: list[str] = []
    while (rewrite := _first(node, context)) is not None:
        node, reason = rewrite
        reasons.append(reason)
    children = []
    for child, here in zip(node.children, child_contexts(node, context), strict=True):
        shorter_child, new = _visit(child, here) if child.children else (child, ())
        children.append(shorter_child)
        reasons += new
    if tuple(children) != node.children:
        node = node._replace(children=tuple(children))
    return node, tuple(reasons)


def _first(node: Node, context: NodeContext) -> Rewrite:
    """The rewrite by the first rule that applies."""
    for rule in RULES[node.kind]:
        if (rewrite := rule(node, context)) is not None:
            return rewrite
    return None
