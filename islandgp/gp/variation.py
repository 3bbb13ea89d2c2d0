"""Variation (section 2.3; line 15 of Algorithm 1): crossover and mutation of trees.

Each operator is a function of trees and a generator, which is consumed. The result of a mutation
operator may exceed the limits or be the same tree; `mutate` then tries again. A new operator is a
function with an entry in CROSSOVERS or MUTATIONS, or its path in the configuration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Final

from pydantic import BaseModel, Field

from islandgp.bt.core.condition import Condition, ConditionExpr, terms, with_term
from islandgp.bt.core.kinds import KINDS, REPEATS
from islandgp.bt.core.node import (
    ActionArgs,
    CountArgs,
    GuardArgs,
    Limits,
    Node,
    levels,
    measured,
    replace_at,
    size,
    spliced,
    walk,
    within,
)
from islandgp.bt.core.parameters import argument_values, leaf_of, referenced
from islandgp.gp import branches
from islandgp.gp.branches import of_node
from islandgp.gp.random_trees import (
    TreeSpace,
    grow,
    inner_node,
    moved_value,
    on_grid,
    random_action,
    random_args,
    random_term,
    random_value,
    weighted,
    weights_of,
)
from islandgp.plugin import function
from islandgp.seeding import Rng

TRIES: Final = 8  # attempts at a mutation that keeps the limits and changes the tree


def _subtree_crossover(rng: Rng, mother: Node, father: Node, limits: Limits) -> Node:
    """Replaces a random subtree of `mother` by one of `father` that fits."""
    nodes, depths = list(walk(mother)), levels(mother)
    index = int(rng.integers(len(nodes)))
    room = limits.max_nodes - len(nodes) + size(nodes[index])
    below = limits.max_depth - depths[index] + 1
    donors = [node for node, n, d in measured(father) if n <= room and d <= below]
    if not donors:
        return mother
    return replace_at(mother, index, donors[rng.integers(len(donors))])


Crossover = Callable[[Rng, Node, Node, Limits], Node]

CROSSOVERS: Final[dict[str, Crossover]] = {
    "subtree": _subtree_crossover,
    "branch": branches.branch_crossover,
}


def crossover(name: str) -> Crossover:
    """The crossover of this name or path. It raises PartError if it returns an invalid child."""
    return function(name, CROSSOVERS, _must_be_child)


def _must_be_child(result: object, _: object, __: object, ___: object, limits: Limits) -> None:
    if not within(_tree(result), limits):
        raise ValueError(
            f"expected a tree of at most {limits.max_nodes} nodes and depth {limits.max_depth},"
            f" found {size(_tree(result))} nodes and depth {max(levels(_tree(result)))}"
        )


def _tree(result: object) -> Node:
    if not isinstance(result, Node):
        raise TypeError(f"expected it to return a tree (Node), found {type(result).__name__}")
    return result


@of_node(lambda *_: True)
def _subtree(rng: Rng, _: Node, space: TreeSpace, settings: MutationSettings) -> Node:
    """Replaces a subtree by a random one."""
    return grow(rng, space, settings.subtree_depth)


@of_node(lambda *_: True)
def _node(rng: Rng, old: Node, space: TreeSpace, _: MutationSettings) -> Node:
    """Replaces the kind of a node, which keeps its children, or an action."""
    if old.action:
        return random_action(rng, space)
    n = len(old.children)
    kinds = [
        name
        for name, kind in KINDS.items()
        if space.kinds.get(name, 0) > 0 and kind.children[0] <= n <= kind.children[1]
    ]
    if not kinds:
        return old
    kind = kinds[rng.integers(len(kinds))]
    return Node(kind, random_args(rng, kind, space), old.children)


@of_node(
    lambda node, space: (
        (node.args and not node.action) or space.vocabulary.action(node.action).arguments
    )
)
def _parameter(rng: Rng, old: Node, space: TreeSpace, settings: MutationSettings) -> Node:
    """Perturbs a number, or replaces an argument, of a node."""
    if isinstance(old.args, ActionArgs):
        return _other_argument(rng, old.args, space, settings)
    args = random_args(rng, old.kind, space)
    nudge = rng.normal(0, settings.number_sd)
    if isinstance(old.args, CountArgs) and not isinstance(old.args.times, str):
        least, most = REPEATS
        moved = round(old.args.times + nudge * space.settings.repeats)
        args = CountArgs(float(min(most, max(least, moved))))
    elif isinstance(old.args, GuardArgs):
        condition = old.args.condition
        if not isinstance(condition, Condition):
            args = old.args._replace(condition=_rejoined(rng, condition, nudge, space))
        elif space.vocabulary.has_number(condition) and rng.random() < 0.5:
            args = old.args._replace(condition=_nudged(condition, space, nudge))
    return old._replace(args=args)


def _other_argument(
    rng: Rng, args: ActionArgs, space: TreeSpace, settings: MutationSettings
) -> Node:
    """A leaf with one of its arguments perturbed, or replaced by a random value."""
    arguments = space.vocabulary.action(args.name).arguments
    values = argument_values(args, arguments)
    key = list(arguments)[rng.integers(len(arguments))]
    if referenced(values[key]) or rng.random() < 0.5:
        values[key] = random_value(rng, arguments[key])
    else:
        by = rng.normal(0, settings.number_sd)
        values[key] = moved_value(rng, arguments[key], values[key], by)
    return leaf_of(args.name, values, arguments)


def _nudged(expr: Condition, space: TreeSpace, nudge: float) -> Condition:
    """A comparison with its number moved by `nudge` times its key's range, on the key's grid."""
    key = space.vocabulary.keys[expr.key]
    moved = expr.number + nudge * (key.high - key.low)
    nearest = on_grid(key, round((moved - key.low) / key.step))
    return expr._replace(number=min(key.high, max(key.low, nearest)))


def _rejoined(rng: Rng, expr: ConditionExpr, nudge: float, space: TreeSpace) -> ConditionExpr:
    """A joined condition with a part removed or changed."""
    parts = list(terms(expr))
    at = int(rng.integers(len(parts)))
    if rng.random() < 0.5:
        return with_term(expr, at, None) or random_term(rng, space)
    if space.vocabulary.has_number(parts[at]) and rng.random() < 0.5:
        return with_term(expr, at, _nudged(parts[at], space, nudge)) or expr
    return with_term(expr, at, random_term(rng, space)) or expr


@of_node(lambda *_: True)
def _insert(rng: Rng, old: Node, space: TreeSpace, settings: MutationSettings) -> Node:
    """Inserts an inner node above a node, or a child into a composite."""
    if old.children and len(old.children) < KINDS[old.kind].children[1] and rng.random() < 0.5:
        at = int(rng.integers(len(old.children) + 1))
        return spliced(old, at, 0, grow(rng, space, settings.subtree_depth))
    parent = inner_node(rng, space, 2)
    if not parent.children:  # a leaf, such as a `set`: the caller tries again
        return old
    return spliced(parent, int(rng.integers(len(parent.children))), 1, old)


@of_node(lambda node, _: node.children)
def _delete(rng: Rng, old: Node, _: TreeSpace, __: MutationSettings) -> Node:
    """Deletes a child of a composite, or replaces an inner node by one of its children."""
    at = int(rng.integers(len(old.children)))
    if len(old.children) > KINDS[old.kind].children[0] and rng.random() < 0.5:
        return spliced(old, at, 1)
    return old.children[at]


@of_node(lambda node, _: len(node.children) > 1)
def _swap(rng: Rng, old: Node, _: TreeSpace, __: MutationSettings) -> Node:
    """Exchanges two children of a composite."""
    a, b = (int(k) for k in rng.choice(len(old.children), 2, replace=False))
    children = list(old.children)
    children[a], children[b] = children[b], children[a]
    return old._replace(children=tuple(children))


MUTATIONS: Final[dict[str, branches.Mutation]] = {
    "subtree": _subtree,
    "node": _node,
    "parameter": _parameter,
    "insert": _insert,
    "delete": _delete,
    "swap": _swap,
    # The operators below treat branches as units; they are not in the paper.
    "guard": branches.guard,
    "wrap": branches.wrap,
    "extend": branches.extend,
    "condition": branches.condition,
    "fulfil": branches.fulfil,
    "tune": branches.tune,
}


class MutationSettings(BaseModel, frozen=True, extra="forbid"):
    """Mutation operators with their weights and strengths."""

    operators: Annotated[
        dict[str, float], weights_of(MUTATIONS, lambda name: function(name, MUTATIONS))
    ]
    """Weight of each of MUTATIONS, or of a "module:function"."""
    subtree_depth: int = Field(ge=1, le=50)  # most levels of a new subtree
    number_sd: float = Field(gt=0, le=1)  # sd of a number's change, as a share of its key's range


def _must_be_mutant(result: object, _: object, __: object, space: TreeSpace, ___: object) -> None:
    for node in walk(_tree(result)):
        if node.action and node.action not in space.vocabulary.actions:
            known = ", ".join(space.vocabulary.actions)
            raise ValueError(f"expected actions of the domain ({known}), found {node.action}")


def mutate(
    rng: Rng, tree: Node, *, rate: float, space: TreeSpace, settings: MutationSettings
) -> tuple[Node, str]:
    """A mutation with probability `rate`: (new tree, operator), else (the same tree, "").

    A mutation that exceeds the limits or changes nothing is tried again; after TRIES attempts the
    tree is returned unchanged.
    """
    if rng.random() >= rate:
        return tree, ""
    for _ in range(TRIES):
        name = weighted(rng, settings.operators)
        new = function(name, MUTATIONS, _must_be_mutant)(rng, tree, space, settings)
        new = space.repaired(new)
        if new != tree and within(new, space.limits):
            return new, name
    return tree, ""
