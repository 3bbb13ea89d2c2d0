"""Priority lists: selectors of guarded branches, and operators that keep a branch whole.

A guarded branch is a child of a selector: typically a `when` with one or a few actions. Most
hand-written trees are lists of such branches, the most urgent first. Subtree crossover and mutation
seldom add a branch, as several nodes must be added at once. The operators of this module add,
exchange and change branches as units. `variation` registers them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from math import exp, floor, log10
from typing import Any, Final

from islandgp.bt.core.condition import (
    ConditionExpr,
    combine,
    numbers_of,
    terms,
    with_number,
    with_term,
)
from islandgp.bt.core.kinds import ABORTS, kind_of
from islandgp.bt.core.node import (
    FAILURE,
    ActionArgs,
    Limits,
    Node,
    depth,
    guard_of,
    guarded,
    replace_at,
    selector,
    sequence,
    size,
    spliced,
    walk,
    within,
)
from islandgp.bt.core.parameters import MAX_MAGNITUDE, argument_values, leaf_of, referenced
from islandgp.bt.core.vocabulary import Key
from islandgp.gp.random_trees import TreeSpace, moved_number, random_abort, random_leaf, random_term
from islandgp.seeding import Rng

Mutation = Callable[[Rng, Node, TreeSpace, Any], Node]
"""(rng, tree, space, its `MutationSettings`) -> the changed tree."""


def of_node(admits: Callable[[Node, TreeSpace], object]) -> Callable[[Mutation], Mutation]:
    """Makes a mutation of a change of one node, which is drawn among those that it admits."""

    def of_tree(change: Mutation) -> Mutation:
        @wraps(change)
        def mutation(rng: Rng, tree: Node, space: TreeSpace, settings: Any) -> Node:
            places = [(i, node) for i, node in enumerate(walk(tree)) if admits(node, space)]
            if not places:
                return tree
            i, node = places[rng.integers(len(places))]
            return replace_at(tree, i, change(rng, node, space, settings))

        return mutation

    return of_tree


BODY: Final = {1: 0.5, 2: 0.4, 3: 0.1}  # probability of each number of actions in a random branch
GUARDED: Final = 0.5
"""Probability that a random branch is guarded by the declared conditions of its first action."""
PREPARED: Final = 0.7
"""Probability that an action of a random branch follows one that it declares as `after`."""
MAX_ACTIONS: Final = 3  # number of actions in a random branch from which on none is added
MAX_TERMS: Final = 3  # of a condition to which none is added
FINE: Final = 200  # tuned thresholds are multiples of about range / FINE
TUNE_ALL: Final = 0.3  # probability that `tune` changes all numbers of a tree, not only one


def random_branch(rng: Rng, space: TreeSpace) -> Node:
    """A guarded branch: `when CONDITION { ACTION }`, or with a short sequence of actions.

    If the first action declares `to_start`, the guard is this condition with probability 1/2.
    Otherwise it is a random condition. Without keys there is no guard.
    """
    body = _random_body(rng, space, 1 + int(rng.choice(len(BODY), p=list(BODY.values()))))
    if not space.keys:
        return body
    declared = space.vocabulary.action(next(_actions(body)).action).to_start
    if declared and rng.random() < GUARDED:
        condition: ConditionExpr = combine("and", declared)
    else:
        condition = _random_condition(rng, space)
    return guarded(condition, body, random_abort(rng, space))


def _actions(tree: Node) -> Iterator[Node]:
    return (node for node in walk(tree) if node.action)


def _random_body(rng: Rng, space: TreeSpace, n: int) -> Node:
    """A sequence of up to `n` random actions, each after its preparations; or a single action.

    No action is added to a sequence of three or more.
    """
    names: list[str] = []
    for _ in range(n):
        if len(names) < MAX_ACTIONS:
            names += _prepared(rng, space.actions[rng.integers(len(space.actions))], space)
    actions = [random_leaf(rng, name, space) for name in names]
    return actions[0] if len(actions) == 1 else sequence(*actions)


def _prepared(rng: Rng, name: str, space: TreeSpace) -> list[str]:
    """The action, preceded by some of those that it declares as `after`, recursively."""
    names = [name]
    options = list(space.vocabulary.action(name).after)
    while options and rng.random() < PREPARED:
        first = options.pop(int(rng.integers(len(options))))
        names = [*_prepared(rng, first, space), *names]
    return names


def random_list(rng: Rng, space: TreeSpace) -> Node:
    """A random priority list: two to five guarded branches, and a last one without a guard."""
    branches = [random_branch(rng, space) for _ in range(int(rng.integers(2, 6)))]
    return selector(*branches, _random_body(rng, space, 1))


def _random_condition(rng: Rng, space: TreeSpace) -> ConditionExpr:
    """A single condition, or two joined by `and` or, less often, `or`."""
    condition = random_term(rng, space)
    if rng.random() < 0.7:
        return condition
    operator = "or" if rng.random() < 0.2 else "and"
    return combine(operator, [condition, random_term(rng, space)])


def _selectors(tree: Node) -> list[tuple[int, Node]]:
    return [
        (i, node) for i, node in enumerate(walk(tree)) if kind_of(node).advance_status == FAILURE
    ]


def branches_of(tree: Node) -> list[Node]:
    """The branches of a tree: the children of its selectors, or the tree if it has no selector."""
    return [c for _, node in _selectors(tree) for c in node.children] or [tree]


def with_branch(rng: Rng, tree: Node, branch: Node) -> Node:
    """The tree with a branch inserted before a child of one of its selectors.

    The outermost selector is the likeliest. A tree without a selector becomes the last child of
    a new one.
    """
    selectors = _selectors(tree)
    if not selectors:
        return selector(branch, tree)
    i, node = selectors[0 if rng.random() < 0.6 else int(rng.integers(len(selectors)))]
    at = int(rng.integers(len(node.children)))  # never last: behind an action nothing is reached
    return replace_at(tree, i, spliced(node, at, 0, branch))


def guard(rng: Rng, tree: Node, space: TreeSpace, _: object) -> Node:
    """Inserts a random guarded branch before a child of a selector."""
    return with_branch(rng, tree, random_branch(rng, space))


@of_node(lambda _, space: space.keys)
def wrap(rng: Rng, node: Node, space: TreeSpace, _: object) -> Node:
    """Puts a `when` with a random condition above a node."""
    return guarded(_random_condition(rng, space), node, random_abort(rng, space))


@of_node(lambda node, _: node.action)
def extend(rng: Rng, leaf: Node, space: TreeSpace, _: object) -> Node:
    """Replaces an action, or adds one before or after it in a sequence.

    The new action may have its preparations, as in a random branch.
    """
    new = _random_body(rng, space, 1)
    where = rng.random()
    if where < 0.5:
        return new
    return sequence(leaf, new) if where < 0.75 else sequence(new, leaf)


@of_node(lambda node, _: node.guard)
def condition(rng: Rng, node: Node, space: TreeSpace, _: object) -> Node:
    """Changes a guard: another abort rule, or a term added, removed or replaced."""
    args = guard_of(node)
    parts = list(terms(args.condition))
    at, draw = int(rng.integers(len(parts))), rng.random()
    if draw < 0.25:
        others = [abort for abort in ABORTS if abort != args.abort]
        return node._replace(args=args._replace(abort=others[rng.integers(len(others))]))
    new: ConditionExpr | None = random_term(rng, space)
    if draw < 0.5 and len(parts) < MAX_TERMS:
        operator = "or" if rng.random() < 0.3 else "and"
        assert new is not None
        new = combine(operator, [parts[at], new])
    elif draw < 0.65:
        new = None
    changed = with_term(args.condition, at, new)
    if changed is None:  # the only term is gone, and the guard with it
        return node.children[0]
    return node._replace(args=args._replace(condition=changed))


def _declared(leaf: Node, space: TreeSpace) -> tuple[ConditionExpr, ...]:
    """The conditions that an action declares in `to_start` and `to_succeed`."""
    declaration = space.vocabulary.action(leaf.action)
    return tuple(dict.fromkeys((*declaration.to_start, *declaration.to_succeed)))


@of_node(lambda node, space: node.action and _declared(node, space))
def fulfil(rng: Rng, leaf: Node, space: TreeSpace, _: object) -> Node:  # noqa: ARG001 -- every mutation's form
    """Guards an action by the conditions that it declares.

    These are `to_start` and `to_succeed` of the vocabulary, which `check` uses, too.
    """
    return guarded(combine("and", _declared(leaf, space)), leaf, "none")


def tune(rng: Rng, tree: Node, space: TreeSpace, mutation: Any) -> Node:
    """Perturbs one number in the tree's conditions, or all of them.

    The standard deviation is drawn for each call, log-uniform from `number_sd` / 20 to
    `number_sd`, as a share of the key's range. Numbers may leave the grid of random thresholds.
    """
    places = places_of_numbers(tree, space)
    if not places:
        return tree
    sd: float = mutation.number_sd * 20 ** (rng.random() - 1)
    if rng.random() >= TUNE_ALL:
        places = [places[rng.integers(len(places))]]
    for i, k in places:
        tree = _moved(tree, i, k, rng.normal(0, sd), space)
    return tree


def places_of_numbers(tree: Node, space: TreeSpace) -> list[tuple[int, int]]:
    """Places of numbers in a tree: (index of the node, index in `_numbers` or of the argument)."""
    places: list[tuple[int, int]] = []
    for i, node in enumerate(walk(tree)):
        if node.guard:
            compared = [True] * len(_numbers(node.guard.condition, space))
        else:
            arguments = space.vocabulary.action(node.action).arguments.values()
            compared = [each.numeric for each in arguments]
        places += [(i, k) for k, number in enumerate(compared) if number]
    return places


def _numbers(expr: ConditionExpr, space: TreeSpace) -> list[tuple[int, int]]:
    """Places of numbers in a condition: (index of the term, index in its numbers)."""
    return [
        (at, place)
        for at, term in enumerate(terms(expr))
        if not term.single or space.vocabulary.has_number(term)
        for place in range(len(numbers_of(term)))
    ]


def _moved(tree: Node, i: int, k: int, by: float, space: TreeSpace) -> Node:
    """The tree with number `k` of node `i` moved by a share of its range."""
    node = next(node for at, node in enumerate(walk(tree)) if at == i)
    if isinstance(node.args, ActionArgs):
        arguments = space.vocabulary.action(node.action).arguments
        values = argument_values(node.args, arguments)
        name = list(arguments)[k]
        if referenced(values[name]):  # a key gives it its value
            return tree
        values[name] = moved_number(arguments[name], float(values[name]), by)
        return replace_at(tree, i, leaf_of(node.action, values, arguments))
    args = guard_of(node)
    at, place = _numbers(args.condition, space)[k]
    term = list(terms(args.condition))[at]
    before = numbers_of(term)[place]
    if term.single:
        key = space.vocabulary.keys[term.key]
        number = fine(before + by * (key.high - key.low), key)
        if key.whole and number == before:  # small steps would leave whole numbers as they are
            number = fine(number + (1 if by > 0 else -1), key)
    elif "/" in term.key + term.other:  # a divisor does not become 0
        number = before * exp(by)
    else:
        number = min(MAX_MAGNITUDE, max(-MAX_MAGNITUDE, round(before + by, 3)))
    changed = with_term(args.condition, at, with_number(term, place, number))
    assert changed is not None
    return replace_at(tree, i, node._replace(args=args._replace(condition=changed)))


def fine(value: float, key: Key) -> float:
    """The value clipped to the key's range and rounded to a multiple of about range / FINE."""
    digit = 10.0 ** floor(log10((key.high - key.low) / FINE))
    unit = 1.0 if key.whole else min(digit, key.step)
    nearest = round(round(value / unit) * unit, 9)
    return min(key.high, max(key.low, nearest)) + 0.0  # no -0


def branch_crossover(rng: Rng, mother: Node, father: Node, limits: Limits) -> Node:
    """Inserts a branch of `father` into a selector of `mother`, or replaces a branch by it."""
    room = limits.max_nodes - size(mother)
    donors = [b for b in branches_of(father) if size(b) < room and depth(b) < limits.max_depth]
    if not donors:
        return mother
    branch = donors[rng.integers(len(donors))]
    selectors = _selectors(mother)
    if not selectors or rng.random() < 0.6:
        child = with_branch(rng, mother, branch)
    else:
        i, node = selectors[rng.integers(len(selectors))]
        at = int(rng.integers(len(node.children)))
        child = replace_at(mother, i, spliced(node, at, 1, branch))
    return child if within(child, limits) else mother
