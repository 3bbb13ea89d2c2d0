"""Conditions that hold on the blackboard when a node of a tree is ticked.

They come from three places:

- A guard with abort self or both holds in each tick in which its child runs; a guard with any abort
  rule holds in the tick in which its child starts.
- A child of a composite starts in a tick in which the one before it has failed (in a sequence:
  succeeded). So the conditions without which that one does not fail hold in this tick.
- While a later child runs, an observed guard of an earlier one is false: when it becomes true, the
  composite goes back.

The analyses of `check` and `simplify` find branches that never run and redundant guards by these
conditions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import count
from typing import Final, NamedTuple

from islandgp.bt.analysis.satisfiability import Conditions, excludes, implies, keys_of
from islandgp.bt.core.condition import Condition, ConditionExpr, combine, opposite, terms
from islandgp.bt.core.kinds import advance_status, is_opaque, kind_of
from islandgp.bt.core.node import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Args,
    GuardArgs,
    Node,
    ParallelArgs,
    actions_in,
    commented,
    count_of,
    guard_of,
    marks_of,
    written_in,
)
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary

MAX_FACTS: Final = 20_000  # entries of a cache; trees of a search share most branches
MAX_ALTERNATIVES: Final = 8  # most terms of a condition that an end of a node implies


class NodeContext(NamedTuple):
    """Conditions that hold when a node is ticked, and whether its guards are observed."""

    always: Conditions = ()  # in each tick in which the node runs
    at_start: Conditions = ()  # in the tick in which it starts; `always` is part of it
    when_observed: Conditions | None = None  # where its guards are observed; None: nowhere
    vocabulary: Vocabulary = EMPTY_VOCABULARY  # the declared actions and keys
    written: frozenset[str] = frozenset()  # keys that change within a tick

    def facts(self, *conditions: ConditionExpr) -> Conditions:
        """The conditions that still hold later in the tick: those without a written key."""
        if not self.written:
            return conditions
        return tuple(each for each in conditions if self.written.isdisjoint(keys_of(each)))


def root_context(tree: Node, vocabulary: Vocabulary) -> NodeContext:
    """The context of the root of a tree."""
    written = written_in(tree).union(*(vocabulary.action(n).sets for n in actions_in(tree)))
    context = NodeContext((), (), None, vocabulary, written)
    always = context.facts(*vocabulary.always)
    return context._replace(always=always, at_start=always)


class Spot(NamedTuple):
    """A node of a tree with its context."""

    place: int  # in document order
    node: Node
    context: NodeContext
    above: tuple[tuple[Spot, int], ...]
    """Its ancestors from the root on, each with the index of the child that leads to it."""


def spots(tree: Node, vocabulary: Vocabulary) -> Iterator[Spot]:
    """The nodes of a tree in document order, each with its context."""
    places = count()

    def visit(
        node: Node, context: NodeContext, above: tuple[tuple[Spot, int], ...]
    ) -> Iterator[Spot]:
        spot = Spot(next(places), node, context, above)
        yield spot
        contexts = child_contexts(node, context)
        for index, (child, here) in enumerate(zip(node.children, contexts, strict=True)):
            yield from visit(child, here, (*above, (spot, index)))

    return visit(tree, root_context(tree, vocabulary), ())


@lru_cache(maxsize=MAX_FACTS)
def child_contexts(node: Node, context: NodeContext) -> tuple[NodeContext, ...]:
    """The contexts of a node's children, in order, derived from the context of the node."""
    return tuple(_child_contexts(node, context))


def _child_contexts(node: Node, context: NodeContext) -> Iterator[NodeContext]:
    kind, always = kind_of(node), context.always
    if kind.remembers_branch:
        yield from _in_order(node, context)
    elif kind.reactive:
        yield from _in_each_tick(node, context)
    elif node.guard:
        holds = context.facts(node.guard.condition)
        if node.guard.checks_itself:
            always = (*always, *holds)
        yield context._replace(always=always, at_start=(*context.at_start, *holds))
    elif kind.concurrent:
        yield from [context._replace(when_observed=None)] * len(node.children)
    elif is_opaque(node):
        observed = context.when_observed if kind.decorates else None
        inside = context._replace(at_start=always, when_observed=observed)
        yield from [inside] * len(node.children)
    elif kind.counts is not None or kind.delayed:  # starts its child in later ticks
        yield context._replace(at_start=always)
    elif kind.decorates:
        yield context


def _in_order(node: Node, context: NodeContext) -> Iterator[NodeContext]:
    """The contexts of the children of a composite that resumes its running child."""
    advance, last = advance_status(node), len(node.children) - 1
    always, entered = context.always, context.at_start
    for index, child in enumerate(node.children):
        observed = None if index == last else always
        here = context._replace(always=always, at_start=entered, when_observed=observed)
        goes_on = end_facts(child, here, advance) is not None
        if index < last and goes_on and has_interrupting_guard(child):
            # Its guard can start the branch once more while a later one runs.
            here = here._replace(at_start=always)
        yield here
        if index == last:
            return
        facts = end_facts(child, here, advance) or ()
        quiet = context.facts(*_while_later_runs(child, (*always, *facts)))
        always = (*always, *quiet)
        same_tick = here.at_start if ends_at_once(child, here) else ()
        entered = (*always, *(each for each in (*same_tick, *facts) if each not in always))


def _in_each_tick(node: Node, context: NodeContext) -> Iterator[NodeContext]:
    """The contexts of the children of a reactive composite: any of them starts in any tick."""
    always = context.always
    for child in node.children:
        here = context._replace(always=always, at_start=always, when_observed=None)
        yield here
        # All children before the next one have ended in this tick.
        always = (*always, *(end_facts(child, here, advance_status(node)) or ()))


def _while_later_runs(child: Node, at_end: Conditions) -> Conditions:
    """The condition that holds in each tick of the branches after a child, if there is one.

    Take the first guards of the child, as long as they interrupt. If they do not hold together when
    it ends (`at_end`), they do not hold together while a later branch is ticked:

    1. When the child ends, let g be the first of them that is false. It was evaluated since the
       child started. Otherwise a guard before it was false when the child ended, and so was
       observed; it is true now, so it has become true, and the composite has gone back.
    2. So g is observed and false. As soon as it becomes true, the composite goes back to the child
       or to a branch before it.
    """
    together: Conditions = ()
    while child.guard and child.guard.interrupts:
        together = (*together, child.guard.condition)
        if excludes(at_end, combine("and", together)):
            return (opposite(combine("and", together)),)
        child = child.children[0]
    return ()


def guard_chain(branch: Node) -> list[GuardArgs]:
    """The guards of a branch, down to its first composite or action."""
    guards = []
    while kind_of(branch).decorates:
        if branch.guard:
            guards.append(branch.guard)
        branch = branch.children[0]
    return guards


def without_interrupts(branch: Node) -> Node:
    """The branch with the guards in its `guard_chain` changed, so that none is observed.

    Abort `both` becomes `self`, and `lower` becomes `none`. Returns `branch` itself if nothing
    changes.
    """
    if not kind_of(branch).decorates:
        return branch
    args: Args = branch.args
    if branch.guard:
        args = branch.guard._replace(abort="self" if branch.guard.checks_itself else "none")
    child = without_interrupts(branch.children[0])
    if args == branch.args and child is branch.children[0]:
        return branch  # it may be a subtree, which keeps its name
    comments = [line for mark in marks_of(branch) for line in mark.comments.lines]
    return commented(Node(branch.kind, args, (child,)), comments)


def has_interrupting_guard(branch: Node) -> bool:
    """True if a guard in the branch's `guard_chain` has abort `lower` or `both`."""
    return any(guard.interrupts for guard in guard_chain(branch))


def never(guard: GuardArgs, context: NodeContext) -> bool:
    """True if the condition of a `when` cannot hold when the guard starts."""
    return excludes(context.at_start, guard.condition)


def always_holds(guard: GuardArgs, context: NodeContext) -> bool:
    """True if a `when` always starts its child and never stops it."""
    if not implies(context.at_start, guard.condition):
        return False
    return not guard.checks_itself or implies(context.always, guard.condition)


def may_interrupt(guard: GuardArgs, context: NodeContext) -> bool:
    """True if a `when` can stop a later branch in this context."""
    if context.when_observed is None or not guard.interrupts:
        return False
    # A condition that is always true, or never, does not become true.
    is_excluded = excludes(context.when_observed, guard.condition)
    return not (is_excluded or implies(context.when_observed, guard.condition))


def abort_effects(node: Node, context: NodeContext) -> tuple[bool, bool]:
    """Whether `abort self` and `abort lower` of a `when` could stop a node in this context."""
    guard = guard_of(node)
    ends = ends_at_once(node.children[0], context)
    stops_child = not ends and not implies(context.always, guard.condition)
    return stops_child, may_interrupt(guard._replace(abort="lower"), context)


def effective_abort(node: Node, context: NodeContext) -> str:
    """The abort rule with which a `when` has the same effect: the default if it is one of them."""
    guard = guard_of(node)
    stops_child, interrupts = abort_effects(node, context)
    for abort in ("both", "none", "self"):
        other = guard._replace(abort=abort)
        same_child = not stops_child or other.checks_itself == guard.checks_itself
        if same_child and (not interrupts or other.interrupts == guard.interrupts):
            return abort
    return guard.abort


def conditions_when_evaluated(guard: GuardArgs, context: NodeContext) -> Conditions:
    """Conditions that hold in each tick in which the condition of a `when` is evaluated."""
    if context.when_observed is not None and guard.interrupts:
        return context.when_observed
    return context.always if guard.checks_itself else context.at_start


def leaf_statuses(node: Node, vocabulary: Vocabulary) -> frozenset[int]:
    """The statuses that a leaf can return."""
    statuses = kind_of(node).statuses
    return statuses(node.args) if statuses else vocabulary.action(node.action).statuses


def ends_at_once(node: Node, context: NodeContext) -> bool:
    """True if a node always ends in the tick in which it starts; False if it is not known."""
    if not node.children:
        return RUNNING not in leaf_statuses(node, context.vocabulary)
    kind = kind_of(node)
    if is_opaque(node) or kind.delayed or (kind.counts is not None and count_of(node) > 1):
        return False
    return all(ends_at_once(child, context) for child in node.children)


@lru_cache(maxsize=MAX_FACTS)  # a node asks for those of its children, and each child again
def end_facts(node: Node, context: NodeContext, status: int) -> Conditions | None:
    """Conditions that hold in each tick in which a node ends with a status.

    Returns:
        The conditions besides those of `context`, perhaps not all; None if the node never ends so.
    """
    if not node.children:
        return () if status in leaf_statuses(node, context.vocabulary) else None
    kind = kind_of(node)
    if is_opaque(node):
        return ()
    if node.guard:
        return _guard_end(node, node.guard, context, status)
    if kind.decorates:
        inside = child_contexts(node, context)[0]
        ends = [s for s in (FAILURE, SUCCESS) if kind.ends[s] == status]
        facts = _either(end_facts(node.children[0], inside, end) for end in ends)
        return () if status == FAILURE and kind.may_fail else facts
    if isinstance(node.args, ParallelArgs):
        return () if status in _parallel_ends(node.args, node, context) else None
    return _composite_end(node, context, status)


def _guard_end(
    node: Node, guard: GuardArgs, context: NodeContext, status: int
) -> Conditions | None:
    child, inside = node.children[0], child_contexts(node, context)[0]
    facts = None if never(guard, context) else end_facts(child, inside, status)
    if status == SUCCESS:
        if facts is not None and (guard.checks_itself or ends_at_once(child, inside)):
            return (*facts, *context.facts(guard.condition))
        return facts
    if always_holds(guard, context):
        return facts
    return _either([context.facts(opposite(guard.condition)), facts])


def _composite_end(node: Node, context: NodeContext, status: int) -> Conditions | None:
    """`end_facts` of a selector or sequence."""
    advance = advance_status(node)
    known = len(context.always)
    ways: list[Conditions] = []
    for child, here in zip(node.children, child_contexts(node, context), strict=True):
        if status != advance and (facts := end_facts(child, here, status)) is not None:
            ways.append((*here.always[known:], *facts))
        if (last := end_facts(child, here, advance)) is None:
            return _either(ways)
    return (
        (*here.always[known:], *last) if status == advance and last is not None else _either(ways)
    )


def _either(ways: Iterable[Conditions | None]) -> Conditions | None:
    """What holds in all of these ways; None is no way."""
    possible = [way for way in ways if way is not None]
    if len(possible) < 2:
        return possible[0] if possible else None
    if not all(possible):
        return ()
    expr = combine("or", [combine("and", way) for way in possible])
    return (expr,) if sum(1 for _ in terms(expr)) <= MAX_ALTERNATIVES else ()


def _parallel_ends(args: ParallelArgs, node: Node, context: NodeContext) -> list[int]:
    """The statuses with which a parallel can end."""
    pairs = list(zip(node.children, child_contexts(node, context), strict=True))
    success, failure = args.needed(len(node.children))
    failing, succeeding = (
        sum(end_facts(child, here, end) is not None for child, here in pairs)
        for end in (FAILURE, SUCCESS)
    )
    # If all children have ended without a decision, too few succeeded: it fails.
    fails = failing >= min(failure, len(node.children) - success + 1)
    return [FAILURE] * fails + [SUCCESS] * (succeeding >= success)


def contradictions(node: Node, context: NodeContext) -> Iterator[tuple[Condition, Conditions]]:
    """What an action needs to succeed but cannot have in its place, with what holds there."""
    action = context.vocabulary.action(node.action)
    for needed, holding in (
        *((needed, context.at_start) for needed in action.to_start),
        *((needed, context.always) for needed in action.to_succeed),
    ):
        if excludes(holding, needed):
            yield needed, holding
