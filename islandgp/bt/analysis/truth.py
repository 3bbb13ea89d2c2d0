"""Conditions that hold on the blackboard when a node of a tree is ticked.

A guard that checks itself (abort self or both) holds in each tick in which
anything below it runs; any guard holds in the tick in which its child starts.
From this follow guards that can never hold and redundant guards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import inf, prod
from typing import Final, NamedTuple, TypeAlias

from islandgp.bt.core.condition import (
    Condition,
    ConditionExpr,
    conjoin,
    opposite,
    ordered,
    terms,
    to_nnf,
)
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import Args, GuardArgs, Node, commented, comments_of
from islandgp.bt.core.vocabulary import NOTHING, Vocabulary

Conditions: TypeAlias = tuple[ConditionExpr, ...]

MOST_CASES: Final = 32  # most cases of conditions joined by `or`
MOST_TERMS: Final = 64  # of all joined conditions that are looked at together


class NodeContext(NamedTuple):
    """Conditions that hold when a node is ticked, and whether its guards are observed."""

    always: Conditions = ()  # in each tick in which the node runs
    at_start: Conditions = ()  # in the tick in which it starts; `always` is part of it
    observer: Conditions | None = None  # whenever its guards are observed; None: they never are
    vocabulary: Vocabulary = NOTHING  # what is known of actions and keys


def root_of(vocabulary: Vocabulary) -> NodeContext:
    """The context of the root of a tree."""
    return NodeContext(vocabulary.always, vocabulary.always, None, vocabulary)


def chain(node: Node) -> list[Node]:
    """The guards of a branch, down to its first composite or action."""
    guards = []
    while kind_of(node).decorates:
        if node.guard:
            guards.append(node)
        node = node.children[0]
    return guards


def with_aborts(branch: Node, change: Mapping[str, str]) -> Node:
    """The branch with other abort rules on the guards of its `chain`: those that `change` names."""
    if not kind_of(branch).decorates:
        return branch
    args: Args = branch.args
    if branch.guard:
        args = branch.guard._replace(abort=change.get(branch.guard.abort, branch.guard.abort))
    child = with_aborts(branch.children[0], change)
    if args == branch.args and child is branch.children[0]:
        return branch  # it may be a subtree, which keeps its name
    comments = [line for lines in comments_of(branch) for line in lines]
    return commented(Node(branch.kind, args, (child,)), comments)


def hidden(branch: Node) -> Node:
    """The branch with guards that are not observed, and that are otherwise the same."""
    return with_aborts(branch, {"both": "self", "lower": "none"})


def exposes(branch: Node) -> bool:
    """True if a composite would observe a guard of this branch."""
    return any(each.guard and each.guard.interrupts for each in chain(branch))


def implies(known: Conditions, expr: ConditionExpr) -> bool:
    """True if `expr` holds on every blackboard on which all of `known` hold.

    False may also mean that this is not known: where very much is joined.
    """
    return excludes(known, opposite(expr))


@lru_cache(maxsize=10_000)  # trees of a population share most of their guards
def excludes(known: Conditions, expr: ConditionExpr) -> bool:
    """True if `expr` holds on no blackboard on which all of `known` hold; as in `implies`."""
    single = [c for c in known if isinstance(c, Condition)]
    if isinstance(expr, Condition) and len(single) == len(known):
        return not _together([*(c for c in single if {*c.keys} == {*expr.keys}), expr])
    return not _possible(_about(known, expr), expr)


def shorter(expr: ConditionExpr, known: Conditions) -> ConditionExpr:
    """A condition with fewer words that is the same wherever all of `known` hold; else `expr`."""
    condition, related = to_nnf(expr), _about(known, expr)
    while (shortened := _without_needless(condition, related)) != condition:
        condition = shortened
    return condition if _words(condition) < _words(expr) else expr


def _words(expr: ConditionExpr) -> int:
    if isinstance(expr, Condition):
        return 2 if expr.operator == "not" else 1
    return (expr.word == "not") + sum(map(_words, expr.parts))


def _without_needless(expr: ConditionExpr, known: Conditions) -> ConditionExpr:
    """Without parts that the others, or `known`, decide already."""
    if isinstance(expr, Condition):
        return expr
    parts = list(expr.parts)
    at = 0
    while at < len(parts) > 1:
        others = parts[:at] + parts[at + 1 :]
        # Where a part of an `and` matters, the others hold; of an `or`, none of them does.
        assumed = (*known, *(others if expr.word == "and" else map(opposite, others)))
        if not _possible(assumed, opposite(parts[at]) if expr.word == "and" else parts[at]):
            parts = others
        else:
            parts[at] = _without_needless(parts[at], assumed)
            at += 1
    return conjoin(expr.word, parts)


def _about(known: Conditions, expr: ConditionExpr) -> Conditions:
    """The conditions in `known` that constrain keys of `expr`, directly or indirectly."""
    keys = {key for term in terms(expr) for key in term.keys}
    remaining = [(c, {key for term in terms(c) for key in term.keys}) for c in known]
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


def _possible(known: Conditions, expr: ConditionExpr) -> bool:
    """True if there may be a blackboard on which all hold."""
    exprs = [to_nnf(expr)]
    room = MOST_TERMS
    for each in known:
        room -= sum(1 for _ in terms(each))
        if room >= 0:  # knowing less is safe
            exprs.append(to_nnf(each))
    joint = conjoin("and", exprs)
    return _cases(joint) > MOST_CASES or _some_case([], [joint])


def _cases(expr: ConditionExpr) -> int:
    """In how many ways a condition that is spread can hold: one part of each `or` must."""
    if isinstance(expr, Condition):
        return 1
    return (prod if expr.word == "and" else sum)(map(_cases, expr.parts))


def _some_case(single: list[Condition], exprs: list[ConditionExpr]) -> bool:
    """True if all of these conditions, in negation normal form, can hold together."""
    if not exprs:
        return _together(single)
    first, *others = exprs
    if isinstance(first, Condition):
        return _some_case([*single, first], others)
    if first.word == "and":
        return _some_case(single, [*first.parts, *others])
    return any(_some_case(single, [part, *others]) for part in first.parts)


def _together(conditions: Sequence[Condition]) -> bool:
    """True if there may be a blackboard on which all of these hold.

    The difference of two keys that are compared counts as a key without a range.
    """
    ranges: dict[tuple[str, ...], _Range] = {}
    for each in map(ordered, conditions):
        ranges.setdefault(each.keys, _Range()).narrow(each.operator, each.number)
    return not any(each.empty() for each in ranges.values())


class _Range:
    """The values of a key with which some conditions hold."""

    __slots__ = ("high", "low", "never", "open_high", "open_low")

    def __init__(self) -> None:
        self.low, self.high = -inf, inf
        self.open_low = self.open_high = False  # whether the end itself is left out
        self.never: set[float] = set()

    def narrow(self, operator: str, number: float) -> None:
        if operator in ("!=", "is"):  # the number of a flag is 0
            self.never.add(number)
        if operator in (">", ">=", "==", "not"):
            self.low, self.open_low = max((self.low, self.open_low), (number, operator == ">"))
        if operator in ("<", "<=", "==", "not"):
            high = min((self.high, not self.open_high), (number, operator != "<"))
            self.high, self.open_high = high[0], not high[1]

    def empty(self) -> bool:
        if self.low != self.high:
            return self.low > self.high
        return self.open_low or self.open_high or self.low in self.never


def child_context(node: Node, context: NodeContext, index: int) -> NodeContext:
    """The context of the child with this index, derived from the context of its parent."""
    always, at_start, observer, vocabulary = context
    kind = kind_of(node)
    if node.guard:
        holds = node.guard.condition
        if node.guard.checks_itself:
            always = (*always, holds)
        return NodeContext(always, (*at_start, holds), observer, vocabulary)
    if kind.together:
        return NodeContext(always, at_start, None, vocabulary)
    if kind.opaque:
        return NodeContext(always, always, observer if kind.decorates else None, vocabulary)
    if kind.reactive:  # any child starts in any tick
        return NodeContext(always, always, None, vocabulary)
    if kind.counts is not None or kind.later:  # starts its child in later ticks
        return NodeContext(always, always, observer, vocabulary)
    if kind.decorates:
        return context
    last = index == len(node.children) - 1
    # The first branch starts with its composite, unless its guard can call it back later.
    starts = index == 0 and (last or not exposes(node.children[0]))
    observer = None if last else always
    return NodeContext(always, at_start if starts else always, observer, vocabulary)


def may_interrupt(guard: GuardArgs, context: NodeContext) -> bool:
    """True if a `when` can stop a later branch in this context."""
    if context.observer is None or not guard.interrupts:
        return False
    # What is never true, or true all the time, does not turn true.
    never = excludes(context.observer, guard.condition)
    return not (never or implies(context.observer, guard.condition))


def whenever_asked(guard: GuardArgs, context: NodeContext) -> Conditions:
    """Conditions that hold in each tick in which the condition of a `when` is evaluated."""
    if context.observer is not None and guard.interrupts:
        return context.observer
    return context.always if guard.checks_itself else context.at_start
