"""Simplifies a tree without changing its behaviour.

The simplified tree calls the same actions in the same ticks and ends with the same statuses, on
every blackboard and for all statuses that the vocabulary declares for the actions. Each rule has a
comment with its justification; the semantics are those of docs/semantics.md. A rewrite must neither
add nor remove a guard that a composite observes while a later branch runs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.analysis.context import (
    NodeContext,
    always_holds,
    child_context,
    child_contexts,
    conditions_when_evaluated,
    effective_abort,
    has_interrupting_guard,
    may_interrupt,
    root_context,
    without_interrupts,
)
from islandgp.bt.analysis.outcomes import child_may_end, dead_end, idle
from islandgp.bt.analysis.satisfiability import Conditions, implies, shortened, without_decimals
from islandgp.bt.core.kind import NodeKind
from islandgp.bt.core.kinds import KINDS, REPEATS, advance_status, kind_of
from islandgp.bt.core.node import (
    FAILURE,
    SUCCESS,
    CountArgs,
    GuardArgs,
    Node,
    ParallelArgs,
    count_of,
    guard_of,
)
from islandgp.bt.core.printer import condition_text, head
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary

Rewrite: TypeAlias = tuple[Node, str] | None  # the simpler node and the reason; None: no change


def _only_child(node: Node, context: NodeContext) -> Rewrite:
    # A composite with one child has the status of the child.
    if len(node.children) > 1:
        return None
    # But the child's guards were not observed, and must not become observed.
    child = node.children[0]
    moved = child if context.when_observed is None else without_interrupts(child)
    return moved, f"{head(node)} has one child"


def _never_gets_there(node: Node, context: NodeContext) -> Rewrite:
    index = dead_end(node, context)
    if index is None:
        return None
    verb = "fails" if advance_status(node) == FAILURE else "succeeds"
    reason = f"{head(node.children[index])} never {verb}, so its {node.kind} never goes on"
    return node._replace(children=node.children[: index + 1]), reason


def _idle_branch(node: Node, context: NodeContext) -> Rewrite:
    # The next branch starts in the same tick, and the guards never become true.
    advance = advance_status(node)
    busy: list[Node] = []
    idling: list[Node] = []
    for child, here in zip(node.children, child_contexts(node, context), strict=True):
        (idling if idle(child, here) == advance else busy).append(child)
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


def _same_parallel_inside(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    # One success (failure) ends both in the same tick; else all children have to fail (succeed).
    if node.args not in (ParallelArgs("all", "one"), ParallelArgs("one", "all")):
        return None
    for index, child in enumerate(node.children):
        if child.kind == node.kind and child.args == node.args:
            children = (*node.children[:index], *child.children, *node.children[index + 1 :])
            return node._replace(children=children), f"{head(node)} directly in the same"
    return None


def _double_inverter(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    child = node.children[0]
    return (child.children[0], "double inverter") if kind_of(child).inverts else None


def _inverted_composite(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    # De Morgan: a selector is a sequence with all statuses inverted. Guards are observed through
    # inverters, so they are not affected.
    child = node.children[0]
    if kind_of(child).advance_status is None:
        return None
    inverted = sum(kind_of(c).inverts for c in child.children)
    if len(child.children) - inverted > inverted:
        return None
    children = tuple(
        c.children[0] if kind_of(c).inverts else node._replace(children=(c,))
        for c in child.children
    )
    return Node(kind_of(child).dual, (), children), f"{child.kind} between inverters"


def _repeats_once(node: Node, context: NodeContext) -> Rewrite:
    child = node.children[0]
    if count_of(node) == 1:
        return child, head(node)
    counted = kind_of(node).counts
    if counted is not None and not child_may_end(node, context, 0, counted):
        verb = "fails" if counted == FAILURE else "succeeds"
        return child, f"{head(child)} never {verb}, so it is never repeated"
    return None


def _double_repeater(node: Node, context: NodeContext) -> Rewrite:  # noqa: ARG001
    # Both take one tick for each success, and fail at the first failure.
    child = node.children[0]
    if child.kind != node.kind:
        return None
    count = count_of(node) * count_of(child)
    if count > REPEATS[1]:
        return None
    return Node(node.kind, CountArgs(count), child.children), f"{node.kind} in a {node.kind}"


def _forced(node: Node, context: NodeContext) -> Rewrite:
    # The node ends with its fixed status in the tick in which the child ends, with any status.
    child = node.children[0]
    kind = kind_of(child)
    if kind.inverts or kind.forces:
        return node._replace(children=child.children), f"{node.kind} above {child.kind}"
    end = kind_of(node).ends[SUCCESS]
    if not child_may_end(node, context, 0, 1 - end):
        verb = "succeeds" if end == SUCCESS else "fails"
        return child, f"{head(child)} {verb} whenever it ends"
    return None


def _holds_anyway(node: Node, context: NodeContext) -> Rewrite:
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
    if may_interrupt(inner, child_context(node, context, 0)) and not guard.interrupts:
        return None
    stops = guard.checks_itself or inner.checks_itself
    abort = {(0, 0): "none", (1, 0): "self", (0, 1): "lower", (1, 1): "both"}
    args = guard._replace(abort=abort[(stops, guard.interrupts)])
    return Node(node.kind, args, child.children), f"{head(node)} twice"


def _weaker_guard(node: Node, context: NodeContext) -> Rewrite:
    # The inner condition implies the outer one, so the inner guard alone has the same effect.
    guard, child = guard_of(node), node.children[0]
    inner = child.guard
    if inner is None or may_interrupt(guard, context):
        return None
    if may_interrupt(inner, child_context(node, context, 0)):
        return None
    if guard.checks_itself and not inner.checks_itself:
        return None
    if not implies((*context.always, inner.condition), guard.condition):
        return None
    return child, f"{head(node)} is implied by the guard below it"


def _shorter_condition(node: Node, context: NodeContext) -> Rewrite:
    # The two conditions are equal in every tick in which the guard is evaluated.
    guard = guard_of(node)
    condition = shortened(guard.condition, conditions_when_evaluated(guard, context))
    if condition == guard.condition:
        return None
    changed = node._replace(args=guard._replace(condition=condition))
    return changed, f"the condition of {head(node)} is equivalent to {condition_text(condition)}"


def _whole_numbers(node: Node, context: NodeContext) -> Rewrite:
    # No whole number lies between a threshold and the rounded one.
    guard = guard_of(node)
    condition = without_decimals(guard.condition, context.vocabulary)
    if condition == guard.condition:
        return None
    changed = node._replace(args=guard._replace(condition=condition))
    return (
        changed,
        f"{condition_text(guard.condition)} of whole numbers is {condition_text(condition)}",
    )


def _needless_abort(node: Node, context: NodeContext) -> Rewrite:
    # The parts that differ never stop a node: the child ends in the tick in which it starts, the
    # condition does not change while the child or a later branch runs, or there is no later branch.
    guard = guard_of(node)
    if (abort := effective_abort(node, context)) == guard.abort:
        return None
    changed = node._replace(args=guard._replace(abort=abort))
    return changed, f"abort {guard.abort} of {head(node)} has the effect of abort {abort}"


_COMPOSITE: Final = (_only_child, _never_gets_there, _idle_branch, _same_inside)
_PARALLEL: Final = (_only_child, _same_parallel_inside)
_INVERTER: Final = (_double_inverter, _inverted_composite)
_REPEATER: Final = (_repeats_once, _double_repeater)
_GUARD: Final = (
    _holds_anyway,
    _guard_twice,
    _weaker_guard,
    _shorter_condition,
    _whole_numbers,
    _needless_abort,
)


def _rules(kind: NodeKind) -> tuple[Callable[[Node, NodeContext], Rewrite], ...]:
    """The rules for the nodes of a kind, in the order of their application."""
    if kind.advance_status is not None:
        return _COMPOSITE
    if kind.args is GuardArgs:
        return _GUARD
    if kind.counts is not None:
        return _REPEATER
    if kind.forces:
        return (_forced,)
    if kind.inverts:
        return _INVERTER
    return _PARALLEL if kind.concurrent else ()


RULES: Final = {name: _rules(kind) for name, kind in KINDS.items()}

Place: TypeAlias = tuple[Node, Conditions, Conditions, Conditions | None, frozenset[str]]
"""A node with its context, without the vocabulary."""

MAX_SHORT: Final = 20_000  # most nodes in this cache
_short: tuple[Vocabulary, set[Place]] = (EMPTY_VOCABULARY, set())
"""The last vocabulary, and nodes that no rule applies to; trees of a search share most branches."""


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
    global _short
    if _short[0] is not vocabulary or len(_short[1]) > MAX_SHORT:
        _short = vocabulary, set()
    short, reasons = _short[1], list[str]()
    while True:
        before = len(reasons)
        tree = _visit(tree, root_context(tree, vocabulary), reasons, short)
        if len(reasons) == before:
            return Simplified(tree, tuple(reasons))


def _visit(node: Node, context: NodeContext, reasons: list[str], short: set[Place]) -> Node:
    """Rewrites nodes from the root down, so the context of a node stays valid."""
    before, place = len(reasons), (node, *context[:3], context.written)
    if place in short:
        return node
    while (rewrite := _first(node, context)) is not None:
        node, reason = rewrite
        reasons.append(reason)
    contexts = child_contexts(node, context)
    for index, child in enumerate(node.children):
        if not child.children:
            continue  # no rule applies to a leaf
        shorter_child = _visit(child, contexts[index], reasons, short)
        if shorter_child is not child:
            children = (*node.children[:index], shorter_child, *node.children[index + 1 :])
            node = node._replace(children=children)
            contexts = child_contexts(node, context)
    if len(reasons) == before:
        short.add(place)
    return node


def _first(node: Node, context: NodeContext) -> Rewrite:
    """The rewrite by the first rule that applies."""
    for rule in RULES[node.kind]:
        if (rewrite := rule(node, context)) is not None:
            return rewrite
    return None
