"""Conditions that hold on the blackboard when a node of a tree is ticked.

A guard with abort self or both holds in each tick in which its child runs; a
guard with any abort rule holds in the tick in which its child starts. The
analyses of `check` and `simplify` find guards that can never hold and redundant
guards by these conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import inf, prod
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.core.condition import (
    Condition,
    ConditionExpr,
    combine,
    opposite,
    ordered,
    terms,
    to_nnf,
)
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import Args, GuardArgs, Node, commented, comments_of
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary

Conditions: TypeAlias = tuple[ConditionExpr, ...]

MAX_CASES: Final = 32  # most cases of conditions joined by `or`
MAX_TERMS: Final = 64  # most comparisons and flags that are analysed together


class NodeContext(NamedTuple):
    """Conditions that hold when a node is ticked, and whether its guards are observed."""

    always: Conditions = ()  # in each tick in which the node runs
    at_start: Conditions = ()  # in the tick in which it starts; `always` is part of it
    when_observed: Conditions | None = None  # where its guards are observed; None: nowhere
    vocabulary: Vocabulary = EMPTY_VOCABULARY  # the declared actions and keys


def root_context(vocabulary: Vocabulary) -> NodeContext:
    """The context of the root of a tree."""
    return NodeContext(vocabulary.always, vocabulary.always, None, vocabulary)


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
    comments = [line for lines in comments_of(branch) for line in lines]
    return commented(Node(branch.kind, args, (child,)), comments)


def has_interrupting_guard(branch: Node) -> bool:
    """True if a guard in the branch's `guard_chain` has abort `lower` or `both`."""
    return any(guard.interrupts for guard in guard_chain(branch))


def implies(premises: Conditions, expr: ConditionExpr) -> bool:
    """True if `expr` holds on every blackboard on which all of `premises` hold.

    It may also return False for a condition that is implied, if more than MAX_CASES cases or
    MAX_TERMS terms would have to be examined.
    """
    return excludes(premises, opposite(expr))


@lru_cache(maxsize=10_000)  # trees of a population share most of their guards
def excludes(premises: Conditions, expr: ConditionExpr) -> bool:
    """True if `expr` holds on no blackboard on which all of `premises` hold.

    It may also return False where that is the case, as `implies`.
    """
    single = [c for c in premises if isinstance(c, Condition)]
    if isinstance(expr, Condition) and len(single) == len(premises):
        return not _satisfiable([*(c for c in single if {*c.keys} == {*expr.keys}), expr])
    return not _consistent(_related(premises, expr), expr)


def shortened(expr: ConditionExpr, premises: Conditions) -> ConditionExpr:
    """A shorter condition with the same value wherever all of `premises` hold, or else `expr`."""
    if isinstance(expr, Condition):
        return expr
    condition, related = to_nnf(expr), _related(premises, expr)
    while (reduced := _without_redundant(condition, related)) != condition:
        condition = reduced
    return condition if _word_count(condition) < _word_count(expr) else expr


def _word_count(expr: ConditionExpr) -> int:
    """The number of terms and of the word `not`."""
    if isinstance(expr, Condition):
        return 2 if expr.operator == "not" else 1
    return (expr.word == "not") + sum(map(_word_count, expr.parts))


def _without_redundant(expr: ConditionExpr, premises: Conditions) -> ConditionExpr:
    """The condition without parts whose value follows from the other parts and `premises`."""
    if isinstance(expr, Condition):
        return expr
    parts = list(expr.parts)
    at = 0
    while at < len(parts) > 1:
        others = parts[:at] + parts[at + 1 :]
        # Where a part of an `and` matters, the others hold; of an `or`, none of them does.
        assumed = (*premises, *(others if expr.word == "and" else map(opposite, others)))
        if not _consistent(assumed, opposite(parts[at]) if expr.word == "and" else parts[at]):
            parts = others
        else:
            parts[at] = _without_redundant(parts[at], assumed)
            at += 1
    return combine(expr.word, parts)


def _related(premises: Conditions, expr: ConditionExpr) -> Conditions:
    """The conditions in `premises` that constrain keys of `expr`, directly or indirectly."""
    keys = {key for term in terms(expr) for key in term.keys}
    remaining = [(c, {key for term in terms(c) for key in term.keys}) for c in premises]
    related: list[ConditionExpr] = []
    grown = True
    while grown:
        grown = False
        unrelated = []
        for each, its_keys in remaining:
            if its_keys & keys:
                related.append(each)
                grown |= not its_keys <= keys
                keys |= its_keys
            else:
                unrelated.append((each, its_keys))
        remaining = unrelated
    return tuple(related)


def _consistent(premises: Conditions, expr: ConditionExpr) -> bool:
    """True if there may be a blackboard on which `expr` and all of `premises` hold."""
    exprs = [to_nnf(expr)]
    terms_left = MAX_TERMS
    for each in premises:
        terms_left -= sum(1 for _ in terms(each))
        if terms_left >= 0:  # dropping a known condition can only turn False into True
            exprs.append(to_nnf(each))
    joint = combine("and", exprs)
    return _case_count(joint) > MAX_CASES or _any_case_holds([], [joint])


def _case_count(expr: ConditionExpr) -> int:
    """The number of conjunctions in the disjunctive normal form of a condition in NNF."""
    if isinstance(expr, Condition):
        return 1
    return (prod if expr.word == "and" else sum)(map(_case_count, expr.parts))


def _any_case_holds(single: list[Condition], exprs: list[ConditionExpr]) -> bool:
    """True if all of these conditions, which are in negation normal form, can hold at once.

    `single` are terms that must hold; `exprs` remain to be split into terms.
    """
    if not exprs:
        return _satisfiable(single)
    first, *others = exprs
    if isinstance(first, Condition):
        return _any_case_holds([*single, first], others)
    if first.word == "and":
        return _any_case_holds(single, [*first.parts, *others])
    return any(_any_case_holds(single, [part, *others]) for part in first.parts)


def _satisfiable(conditions: Sequence[Condition]) -> bool:
    """True if there may be a blackboard on which all of these conditions hold.

    A comparison of two keys is treated as a comparison of their difference with 0.
    """
    by_keys: dict[tuple[str, ...], list[Condition]] = {}
    for each in map(ordered, conditions):
        by_keys.setdefault(each.keys, []).append(each)
    return all(map(_has_value, by_keys.values()))


def _has_value(conditions: Sequence[Condition]) -> bool:
    """True if a number satisfies all of these conditions, which have the same keys."""
    # The bounds are (x, False), just below x, and (x, True), just above it.
    low, high = (-inf, False), (inf, True)
    excluded = set()
    for _, operator, number, _ in conditions:
        if operator in ("!=", "is"):  # the number of a flag is 0
            excluded.add(number)
        if operator in (">", ">=", "==", "not"):
            low = max(low, (number, operator == ">"))
        if operator in ("<", "<=", "==", "not"):
            high = min(high, (number, operator != "<"))
    return low < high and not (low[0] == high[0] and low[0] in excluded)


def child_context(node: Node, context: NodeContext, index: int) -> NodeContext:
    """The context of the child with this index, derived from the context of its parent."""
    always, at_start, when_observed, vocabulary = context
    kind = kind_of(node)
    if node.guard:
        holds = node.guard.condition
        if node.guard.checks_itself:
            always = (*always, holds)
        return NodeContext(always, (*at_start, holds), when_observed, vocabulary)
    if kind.concurrent:
        return NodeContext(always, at_start, None, vocabulary)
    if kind.opaque:
        return NodeContext(always, always, when_observed if kind.decorates else None, vocabulary)
    if kind.reactive:  # any child starts in any tick
        return NodeContext(always, always, None, vocabulary)
    if kind.counts is not None or kind.delayed:  # starts its child in later ticks
        return NodeContext(always, always, when_observed, vocabulary)
    if kind.decorates:
        return context
    last = index == len(node.children) - 1
    # The first branch starts with its composite, unless its guard can start it once more.
    starts = index == 0 and (last or not has_interrupting_guard(node.children[0]))
    when_observed = None if last else always
    return NodeContext(always, at_start if starts else always, when_observed, vocabulary)


def may_interrupt(guard: GuardArgs, context: NodeContext) -> bool:
    """True if a `when` can stop a later branch in this context."""
    if context.when_observed is None or not guard.interrupts:
        return False
    # A condition that is always true, or never, does not become true.
    is_excluded = excludes(context.when_observed, guard.condition)
    return not (is_excluded or implies(context.when_observed, guard.condition))


def conditions_when_evaluated(guard: GuardArgs, context: NodeContext) -> Conditions:
    """Conditions that hold in each tick in which the condition of a `when` is evaluated."""
    if context.when_observed is not None and guard.interrupts:
        return context.when_observed
    return context.always if guard.checks_itself else context.at_start
